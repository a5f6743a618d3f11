// exp and pow with the same bits on every thread, on Windows.
//
// mingw-w64 computes them on the x87 unit, whose precision is a setting of each thread: 53 bits
// where Windows begins a thread, 64 where its own runtime does. The linker sends calls here
// (--wrap).

namespace {

/// 64 bits until the end of the scope.
class WholePrecision {
public:
    WholePrecision() {
        asm volatile("fnstcw %0" : "=m"(before_));
        set(static_cast<unsigned short>(before_ | kWhole));
    }
    ~WholePrecision() { set(before_); }
    WholePrecision(const WholePrecision&) = delete;
    WholePrecision& operator=(const WholePrecision&) = delete;

private:
    static constexpr unsigned short kWhole = 0x300;

    static void set(unsigned short control) { asm volatile("fldcw %0" : : "m"(control)); }

    unsigned short before_ = 0;
};

}  // namespace

extern "C" {

double __real_exp(double x);
double __real_pow(double x, double y);

double __wrap_exp(double x) {
    const WholePrecision whole;
    return __real_exp(x);
}

double __wrap_pow(double x, double y) {
    const WholePrecision whole;
    return __real_pow(x, y);
}

}  // extern "C"
