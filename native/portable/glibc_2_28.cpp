// Calls of functions that glibc has changed since 2.28, sent to the version that it had before, so
// that the module can be loaded on older systems as well. The linker sends them here (--wrap, see
// CMakeLists.txt): the module is compiled as ever. These versions do the same; newer ones differ in
// how errors are told, or in the library that they lie in.
#include <pthread.h>

#define OLDER(name, type, parameters, arguments)              \
    extern "C" type older_##name parameters;                  \
    __asm__(".symver older_" #name "," #name "@GLIBC_2.2.5"); \
    extern "C" type __wrap_##name parameters {                \
        return older_##name arguments;                        \
    }

OLDER(pthread_attr_setstacksize, int, (pthread_attr_t * attributes, size_t size),
      (attributes, size))
OLDER(pthread_create, int,
      (pthread_t * thread, const pthread_attr_t* attributes, void* (*run)(void*), void* argument),
      (thread, attributes, run, argument))
OLDER(pthread_join, int, (pthread_t thread, void** result), (thread, result))
OLDER(pthread_once, int, (pthread_once_t * done, void (*run)()), (done, run))

/// False, so that shared pointers count with atomic operations: glibc says since 2.32 whether they
/// must.
extern "C" __attribute__((visibility("hidden"))) char __libc_single_threaded;
char __libc_single_threaded = 0;
