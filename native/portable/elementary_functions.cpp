// Calls of the C library's elementary functions, sent to the project's own, which have the same
// bits on every system. The linker sends them here (--wrap, see CMakeLists.txt), also those from
// Eigen: sources are compiled as ever.
#include "base/elementary.hpp"

extern "C" {

double __wrap_exp(double x) {
    return pointmorph::exponential(x);
}
double __wrap_log(double x) {
    return pointmorph::logarithm(x);
}
double __wrap_log1p(double x) {
    return pointmorph::logarithm_after_one(x);
}
double __wrap_pow(double x, double y) {
    return pointmorph::power(x, y);
}
double __wrap_sin(double x) {
    return pointmorph::sine_of(x);
}
double __wrap_cos(double x) {
    return pointmorph::cosine_of(x);
}

/// Both at once, as GCC calls them.
void __wrap_sincos(double x, double* sine, double* cosine) {
    const pointmorph::QuarterTurns turns(x);
    *sine = turns.sine();
    *cosine = turns.cosine();
}

}  // extern "C"
