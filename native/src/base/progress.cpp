#include "pointmorph/base/progress.hpp"

#include <algorithm>
#include <exception>
#include <utility>

#include "pointmorph/base/error.hpp"

namespace pointmorph {

void Progress::enter(std::string_view stage) {
    finish();
    stage_ = stage;
    stage_start_ = Clock::now();
    in_stage_ = true;
    last_call_ = {};
    done_ = 0.0;
    poll(0.0);
    throw_if_cancelled();
}

void Progress::finish() {
    if (!in_stage_) return;
    in_stage_ = false;
    const double seconds = std::chrono::duration<double>(Clock::now() - stage_start_).count();
    const auto known = std::ranges::find(stages_, stage_, &StageTime::stage);
    if (known != stages_.end())
        known->seconds += seconds;
    else
        stages_.push_back({stage_, seconds});
}

void Progress::report(double fraction) {
    poll(fraction);
    throw_if_cancelled();
}

bool Progress::poll(double fraction) noexcept {
    // Within a stage, what was said isn't taken back, also where a step has no share of its own.
    done_ = std::max(done_, first_ + (last_ - first_) * std::clamp(fraction, 0.0, 1.0));
    return poll();
}

bool Progress::poll() noexcept {
    if (!callback_ || cancelled()) return !cancelled();
    const auto now = Clock::now();
    if (now - last_call_ < interval_) return true;
    last_call_ = now;
    try {
        if (!callback_(stage_, done_)) cancelled_ = true;
    } catch (...) {
        callback_error_ = std::current_exception();
        cancelled_ = true;
    }
    return !cancelled();
}

void Progress::throw_if_cancelled() {
    if (callback_error_) std::rethrow_exception(std::exchange(callback_error_, nullptr));
    if (cancelled()) throw Cancelled();
}

}  // namespace pointmorph
