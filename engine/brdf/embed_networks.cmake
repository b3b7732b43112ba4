# cmake -DWEIGHTS=file -DNAMES=file -DOUT=file -P embed_networks.cmake: a C++ source with the weights as 32-bit words and
# the names, so that the programs need no file beside them. Words and not bytes: the source then means the same on any machine.
file(READ ${WEIGHTS} words HEX)
string(REGEX REPLACE "(..)(..)(..)(..)" "0x\\4\\3\\2\\1u," words "${words}")
string(REGEX REPLACE "(............................................................................................................)" "\\1\n" words "${words}")
file(STRINGS ${NAMES} names)
set(quoted "")
foreach(name IN LISTS names)
  string(APPEND quoted "    \"${name}\",\n")
endforeach()
file(WRITE ${OUT} "// Made by engine/brdf/embed_networks.cmake from resources/basis.
#include <cstddef>
#include <cstdint>

namespace patina::embedded {
extern const std::uint32_t kNetworkWords[] = {
${words}
};
extern const std::size_t kNetworkWordCount = sizeof(kNetworkWords) / sizeof(kNetworkWords[0]);
extern const char* const kNetworkNames[] = {
${quoted}};
extern const std::size_t kNetworkNameCount = sizeof(kNetworkNames) / sizeof(kNetworkNames[0]);
}  // namespace patina::embedded
")
