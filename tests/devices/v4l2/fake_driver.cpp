// A video device that isn't there: preloaded (LD_PRELOAD) into a program it answers for /dev/video90 as a
// kernel driver would (fake_device.h says what it is told by). Here are the calls that it stands in for.
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <stdio.h>
#include <sys/mman.h>
#include <sys/select.h>
#include <sys/stat.h>
#include <sys/sysmacros.h>
#include <sys/timerfd.h>
#include <sys/uio.h>
#include <unistd.h>

#include <cstdarg>
#include <cstring>
#include <vector>

#include "tests/devices/v4l2/fake_device.h"

using namespace patina::test;

namespace {

constexpr const char* kNode = "/dev/video90";
constexpr const char* kUevent = "/sys/dev/char/81:90/uevent";
constexpr unsigned kMajor = 81, kMinor = 90;

template <typename Function>
Function* real(const char* name) {
  return reinterpret_cast<Function*>(dlsym(RTLD_NEXT, name));
}

int fail(int code) {
  errno = code;
  return -1;
}

bool isOurs(int descriptor) {
  const std::lock_guard lock(device().mutex);
  return device().descriptors.count(descriptor) > 0;
}

/// The mode of an open that makes a file.
mode_t modeOf(int flags, va_list list) {
  return flags & (O_CREAT | O_TMPFILE) ? va_arg(list, mode_t) : 0;
}

bool isNode(const char* given) {
  const char* volatile path = given;  // volatile: the library promises the compiler that it is not null
  return path && strcmp(path, kNode) == 0;
}

template <typename Stat>
int statNode(Stat* to) {
  memset(to, 0, sizeof *to);
  to->st_mode = S_IFCHR | 0660;
  to->st_rdev = makedev(kMajor, kMinor);
  return 0;
}

/// Copies memory of the caller's as a kernel does: false where the pointer is bad.
bool copyFromCaller(void* to, const void* from, std::size_t size) {
  const iovec local{to, size}, remote{const_cast<void*>(from), size};
  return process_vm_readv(getpid(), &local, 1, &remote, 1, 0) == static_cast<ssize_t>(size);
}
bool copyToCaller(void* to, const void* from, std::size_t size) {
  const iovec local{const_cast<void*>(from), size}, remote{to, size};
  return process_vm_writev(getpid(), &local, 1, &remote, 1, 0) == static_cast<ssize_t>(size);
}

/// An ioctl with its argument copied in and out.
int answerCaller(int descriptor, unsigned long request, void* argument) {
  alignas(16) unsigned char copy[1 << 14] = {};
  if (!knows(request)) return ENOTTY;
  const std::size_t size = _IOC_SIZE(request);
  if (size > 0 && !copyFromCaller(copy, argument, size)) return EFAULT;
  if (request == VIDIOC_G_EXT_CTRLS || request == VIDIOC_S_EXT_CTRLS || request == VIDIOC_TRY_EXT_CTRLS) {
    v4l2_ext_controls list;
    memcpy(&list, copy, sizeof list);
    unsigned char probe[sizeof(v4l2_ext_control)];
    if (list.count > 1024) return EINVAL;
    for (unsigned i = 0; i < list.count; ++i)
      if (!copyFromCaller(probe, list.controls + i, sizeof probe)) return EFAULT;
  }
  const int code = answer(device(), descriptor, request, copy);
  arm(device());
  if (size > 0 && (_IOC_DIR(request) & _IOC_READ) && !copyToCaller(argument, copy, size)) return EFAULT;
  return code;
}

int openFake(int flags) {
  Device& d = device();
  const std::lock_guard lock(d.mutex);
  if (d.descriptors.empty() && !d.unplugged()) d.reset();
  if (d.unplugged()) return fail(ENODEV);
  // A timer: select, epoll, dup and close understand it by themselves.
  const int descriptor = timerfd_create(CLOCK_MONOTONIC, flags & O_CLOEXEC ? TFD_CLOEXEC : 0);
  if (descriptor >= 0) {
    if (flags & O_NONBLOCK) fcntl(descriptor, F_SETFL, O_NONBLOCK);
    d.descriptors.insert(descriptor);
  }
  return descriptor;
}

}  // namespace

extern "C" {

int open(const char* path, int flags, ...) {
  va_list list;
  va_start(list, flags);
  const mode_t mode = modeOf(flags, list);
  va_end(list);
  if (isNode(path)) return openFake(flags);
  return real<int(const char*, int, ...)>("open")(path, flags, mode);
}
int open64(const char* path, int flags, ...) {
  va_list list;
  va_start(list, flags);
  const mode_t mode = modeOf(flags, list);
  va_end(list);
  if (isNode(path)) return openFake(flags);
  return real<int(const char*, int, ...)>("open64")(path, flags, mode);
}
int openat(int folder, const char* path, int flags, ...) {
  va_list list;
  va_start(list, flags);
  const mode_t mode = modeOf(flags, list);
  va_end(list);
  if (isNode(path)) return openFake(flags);
  return real<int(int, const char*, int, ...)>("openat")(folder, path, flags, mode);
}
int __open_2(const char* path, int flags) {
  if (isNode(path)) return openFake(flags);
  return real<int(const char*, int)>("__open_2")(path, flags);
}
int __open64_2(const char* path, int flags) {
  if (isNode(path)) return openFake(flags);
  return real<int(const char*, int)>("__open64_2")(path, flags);
}

int close(int descriptor) {
  if (isOurs(descriptor)) {
    Device& d = device();
    const std::lock_guard lock(d.mutex);
    d.descriptors.erase(descriptor);
    d.priorities.erase(descriptor);
    d.subscribed.erase(descriptor);
    d.events.erase(descriptor);
    if (d.streamer == descriptor) freeBuffers(d);
  }
  return real<int(int)>("close")(descriptor);
}

int dup(int descriptor) {
  const int copy = real<int(int)>("dup")(descriptor);
  if (copy >= 0 && isOurs(descriptor)) {
    const std::lock_guard lock(device().mutex);
    device().descriptors.insert(copy);
  }
  return copy;
}

int ioctl(int descriptor, unsigned long request, ...) {
  va_list list;
  va_start(list, request);
  void* argument = va_arg(list, void*);
  va_end(list);
  if (!isOurs(descriptor)) return real<int(int, unsigned long, ...)>("ioctl")(descriptor, request, argument);
  Device& d = device();
  request &= 0xFFFFFFFFul;
  const bool blocking = request == VIDIOC_DQBUF && !(fcntl(descriptor, F_GETFL) & O_NONBLOCK);
  for (;;) {
    int code = 0;
    {
      const std::lock_guard lock(d.mutex);
      code = answerCaller(descriptor, request, argument);
    }
    if (code == 0) return 0;
    if (code != EAGAIN || !blocking) return fail(code);
    usleep(1000);
  }
}

void* mmap(void* at, std::size_t length, int protection, int flags, int descriptor, off_t offset) {
  auto* map = real<void*(void*, std::size_t, int, int, int, off_t)>("mmap");
  if (descriptor < 0 || !isOurs(descriptor)) return map(at, length, protection, flags, descriptor, offset);
  Device& d = device();
  const std::lock_guard lock(d.mutex);
  if (d.memory < 0) {
    errno = EINVAL;
    return MAP_FAILED;
  }
  for (std::size_t i = 0; i < d.buffers.size(); ++i)
    if (static_cast<off_t>(i * d.buffers[i].length) == offset && length <= d.buffers[i].length) {
      d.buffers[i].mapped = true;
      return map(at, length, protection, flags, d.memory, offset);
    }
  errno = EINVAL;
  return MAP_FAILED;
}
void* mmap64(void* at, std::size_t length, int protection, int flags, int descriptor, off64_t offset) {
  return mmap(at, length, protection, flags, descriptor, static_cast<off_t>(offset));
}

int poll(pollfd* sources, nfds_t count, int timeoutMs) {
  auto* realPoll = real<int(pollfd*, nfds_t, int)>("poll");
  bool ours = false;
  for (nfds_t i = 0; i < count; ++i) ours |= sources[i].fd >= 0 && isOurs(sources[i].fd);
  if (!ours) return realPoll(sources, count, timeoutMs);
  const double until = timeoutMs < 0 ? 1e18 : now() + timeoutMs / 1000.0;
  for (;;) {
    int ready = 0;
    std::vector<pollfd> others(sources, sources + count);
    for (pollfd& other : others)
      if (other.fd >= 0 && isOurs(other.fd)) other.fd = -1;
    realPoll(others.data(), count, 0);
    for (nfds_t i = 0; i < count; ++i) {
      sources[i].revents = others[i].revents;
      if (sources[i].fd >= 0 && isOurs(sources[i].fd)) {
        Device& d = device();
        const std::lock_guard lock(d.mutex);
        produce(d);
        sources[i].revents = 0;
        if (!d.streaming || d.unplugged())
          sources[i].revents = POLLERR;
        else if (firstDone(d) >= 0)
          sources[i].revents = static_cast<short>(sources[i].events & (POLLIN | POLLRDNORM));
      }
      ready += sources[i].revents != 0;
    }
    if (ready > 0 || now() >= until) return ready;
    usleep(1000);
  }
}
int select(int count, fd_set* reading, fd_set* writing, fd_set* exceptional, struct timeval* timeout) {
  // Events of controls are what an exception is here; a timer knows none.
  for (int i = 0; exceptional && i < count; ++i) {
    if (!FD_ISSET(i, exceptional) || !isOurs(i)) continue;
    const std::lock_guard lock(device().mutex);
    if (device().events[i].empty()) continue;
    if (reading) FD_ZERO(reading);
    if (writing) FD_ZERO(writing);
    FD_ZERO(exceptional);
    FD_SET(i, exceptional);
    return 1;
  }
  return real<int(int, fd_set*, fd_set*, fd_set*, timeval*)>("select")(count, reading, writing, exceptional,
                                                                       timeout);
}
int __poll_chk(pollfd* sources, nfds_t count, int timeoutMs, std::size_t) {
  return poll(sources, count, timeoutMs);
}

ssize_t read(int descriptor, void* to, std::size_t count) {
  if (isOurs(descriptor)) return fail(EINVAL);  // streaming only
  return real<ssize_t(int, void*, std::size_t)>("read")(descriptor, to, count);
}

// v4l2-ctl and v4l2-compliance look at the node before they open it.
int stat(const char* path, struct stat* to) {
  if (isNode(path)) return statNode(to);
  return real<int(const char*, struct stat*)>("stat")(path, to);
}
int stat64(const char* path, struct stat64* to) {
  if (isNode(path)) return statNode(to);
  return real<int(const char*, struct stat64*)>("stat64")(path, to);
}
int fstat(int descriptor, struct stat* to) {
  const int result = real<int(int, struct stat*)>("fstat")(descriptor, to);
  if (result == 0 && isOurs(descriptor)) {
    to->st_mode = S_IFCHR | 0660;
    to->st_rdev = makedev(kMajor, kMinor);
  }
  return result;
}

/// How these tools learn what kind of device a node is.
FILE* fopen64(const char* path, const char* mode) {
  if (strcmp(path, kUevent) == 0) {
    constexpr char kText[] = "MAJOR=81\nMINOR=90\nDEVNAME=video90\n";
    const int file = memfd_create("uevent", MFD_CLOEXEC);
    if (file < 0 || ::write(file, kText, sizeof kText - 1) < 0) return nullptr;
    lseek(file, 0, SEEK_SET);
    return fdopen(file, "r");
  }
  return real<FILE*(const char*, const char*)>("fopen64")(path, mode);
}
FILE* fopen(const char* path, const char* mode) {
  return fopen64(path, mode);
}
}  // extern "C"
