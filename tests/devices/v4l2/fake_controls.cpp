#include <errno.h>

#include "tests/devices/v4l2/fake_device.h"

namespace patina::test {

int setControl(Device& d, std::uint32_t id, int value, bool clampIt) {
  Control* control = d.find(id);
  if (!control) return EINVAL;
  if (control->type == V4L2_CTRL_TYPE_CTRL_CLASS) return EACCES;
  if (control->type == V4L2_CTRL_TYPE_MENU) {
    if (value < control->least || value > control->most) return ERANGE;
    if (!d.menuHas(*control, value)) return EINVAL;
  } else if (value < control->least || value > control->most) {
    if (!clampIt) return ERANGE;
    value = std::clamp(value, control->least, control->most);
  }
  if (control->type == V4L2_CTRL_TYPE_INTEGER)
    value = control->least + (value - control->least + control->step / 2) / control->step * control->step;
  if (control->type == V4L2_CTRL_TYPE_BOOLEAN) value = value != 0;
  if (said("keeps-exposure") && (id == V4L2_CID_EXPOSURE_ABSOLUTE || id == V4L2_CID_EXPOSURE)) return 0;
  control->value = std::min(value, control->most);
  d.pending.emplace_back(static_cast<int>(d.sequence) + number("late", 2), d.light());
  if (!d.streaming) {
    d.pending.clear();
    d.inForce = d.light();
  }
  return 0;
}

int queryControl(Device& d, std::uint32_t id, Control** found) {
  const bool next = id & V4L2_CTRL_FLAG_NEXT_CTRL;
  const std::uint32_t plain = id & V4L2_CTRL_ID_MASK;
  if (id & V4L2_CTRL_FLAG_NEXT_COMPOUND && !next) return EINVAL;
  for (Control& control : d.controls)
    if (next ? control.id > plain : control.id == plain) {
      *found = &control;
      return 0;
    }
  return EINVAL;
}

std::uint32_t flagsOf(Device& d, const Control& control) {
  std::uint32_t flags = 0;
  if (control.type == V4L2_CTRL_TYPE_CTRL_CLASS) return V4L2_CTRL_FLAG_READ_ONLY | V4L2_CTRL_FLAG_WRITE_ONLY;
  if (d.inactive(control.id)) flags |= V4L2_CTRL_FLAG_INACTIVE;
  if (control.id == V4L2_CID_EXPOSURE_AUTO || control.id == V4L2_CID_AUTO_WHITE_BALANCE ||
      control.id == V4L2_CID_FOCUS_AUTO)
    flags |= V4L2_CTRL_FLAG_UPDATE;
  return flags;
}

v4l2_event eventOf(Device& d, const Control& control) {
  v4l2_event event{};
  event.type = V4L2_EVENT_CTRL;
  event.id = control.id;
  event.u.ctrl.changes =
      V4L2_EVENT_CTRL_CH_FLAGS | (control.type == V4L2_CTRL_TYPE_CTRL_CLASS ? 0 : V4L2_EVENT_CTRL_CH_VALUE);
  event.u.ctrl.type = control.type;
  event.u.ctrl.value = control.value;
  event.u.ctrl.flags = flagsOf(d, control);
  event.u.ctrl.minimum = control.least;
  event.u.ctrl.maximum = control.most;
  event.u.ctrl.step = control.step;
  event.u.ctrl.default_value = control.standard;
  return event;
}

int extended(Device& d, unsigned long request, v4l2_ext_controls* list) {
  const bool get = request == VIDIOC_G_EXT_CTRLS, tryOnly = request == VIDIOC_TRY_EXT_CTRLS;
  if (list->which == V4L2_CTRL_WHICH_REQUEST_VAL) return EINVAL;
  if (list->which == V4L2_CTRL_WHICH_DEF_VAL && !get) return EINVAL;
  list->error_idx = list->count;
  if (list->count == 0) {
    if (list->which == V4L2_CTRL_WHICH_CUR_VAL || list->which == V4L2_CTRL_WHICH_DEF_VAL) return 0;
    for (const Control& control : d.controls)
      if (V4L2_CTRL_ID2WHICH(control.id) == list->which) return 0;
    return EINVAL;
  }
  for (unsigned i = 0; i < list->count; ++i) {
    v4l2_ext_control& one = list->controls[i];
    const bool ofClass = list->which == V4L2_CTRL_WHICH_CUR_VAL || list->which == V4L2_CTRL_WHICH_DEF_VAL ||
                         V4L2_CTRL_ID2WHICH(one.id) == list->which;
    const Control* control = d.find(one.id);
    if (control && control->type == V4L2_CTRL_TYPE_CTRL_CLASS) {
      list->error_idx = tryOnly ? i : list->count;
      return EACCES;
    }
    if (!control || !ofClass) {
      list->error_idx = tryOnly ? i : list->count;
      return EINVAL;
    }
    if (!get && control->type == V4L2_CTRL_TYPE_MENU &&
        (one.value < control->least || one.value > control->most || !d.menuHas(*control, one.value))) {
      list->error_idx = tryOnly ? i : list->count;
      return one.value < control->least || one.value > control->most ? ERANGE : EINVAL;
    }
  }
  for (unsigned i = 0; i < list->count; ++i) {
    v4l2_ext_control& one = list->controls[i];
    Control* control = d.find(one.id);
    if (get) {
      one.value = list->which == V4L2_CTRL_WHICH_DEF_VAL ? control->standard : control->value;
    } else {
      int value = std::clamp(one.value, control->least, control->most);
      if (control->type == V4L2_CTRL_TYPE_INTEGER)
        value = control->least + (value - control->least + control->step / 2) / control->step * control->step;
      value = std::min(value, control->most);
      if (!tryOnly)
        if (const int code = setControl(d, one.id, value, true)) return code;
      one.value = value;
    }
  }
  return 0;
}

}  // namespace patina::test
