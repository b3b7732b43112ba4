#pragma once

namespace patina {

/// What must be settled before the application object exists: the OpenGL format that VTK needs, and the
/// platform plugin.
void prepareApplication();

}  // namespace patina
