// How a long computation tells the caller how far it is, and learns that it should end.
#pragma once

#include <atomic>
#include <chrono>
#include <exception>
#include <functional>
#include <string>
#include <string_view>
#include <vector>

namespace pointmorph {

/// Wall time of one stage.
struct StageTime {
    std::string stage;
    double seconds;
};

/// Passed by reference through all stages. `report` and `enter` belong to the thread that started
/// the computation; `cancelled` may be asked from any thread.
class Progress {
public:
    /// Gets the stage's name and the fraction done of it, 0 to 1; returns false to ask for the
    /// end. Called in the computing thread at most once an interval, but for each stage's start.
    using Callback = std::function<bool(std::string_view stage, double fraction)>;

    /// Silent, and never cancelled.
    Progress() = default;
    explicit Progress(Callback callback,
                      std::chrono::milliseconds interval = std::chrono::milliseconds(20))
        : callback_(std::move(callback)), interval_(interval) {}

    Progress(const Progress&) = delete;
    Progress& operator=(const Progress&) = delete;

    /// Ends the stage before and starts the next. Throws Cancelled.
    void enter(std::string_view stage);

    /// Ends the last stage: its time is complete.
    void finish();

    /// While it lives, fractions 0 to 1 mean `first` to `last` of the present stage: for a stage
    /// that does the same to both clouds. Inside another one, of its share.
    class Part {
    public:
        Part(Progress& progress, double first, double last)
            : progress_(progress), outer_first_(progress.first_), outer_last_(progress.last_) {
            const double share = outer_last_ - outer_first_;
            progress_.first_ = outer_first_ + share * first;
            progress_.last_ = outer_first_ + share * last;
        }
        ~Part() {
            progress_.first_ = outer_first_;
            progress_.last_ = outer_last_;
        }
        Part(const Part&) = delete;
        Part& operator=(const Part&) = delete;

    private:
        Progress& progress_;
        double outer_first_, outer_last_;
    };

    /// Reports the fraction done of the present stage, 0 to 1. Throws Cancelled.
    void report(double fraction);

    /// True from the moment that the callback has asked for the end.
    bool cancelled() const noexcept { return cancelled_.load(std::memory_order_relaxed); }

    /// Lets the callback speak, no more often than its interval. Returns `!cancelled()`; doesn't
    /// throw, so that it can be called inside a parallel region by the thread that owns it.
    bool poll(double fraction) noexcept;
    /// The same with the fraction that was said last, by a thread that waits.
    bool poll() noexcept;

    /// Rethrows what the callback threw; else throws Cancelled when `cancelled()`.
    void throw_if_cancelled();

    /// Seconds by stage, in the order in which the stages were entered. A stage that was entered
    /// twice is listed once with the sum.
    const std::vector<StageTime>& stages() const noexcept { return stages_; }

private:
    using Clock = std::chrono::steady_clock;

    Callback callback_;
    std::chrono::milliseconds interval_{};
    std::exception_ptr callback_error_;
    std::atomic<bool> cancelled_{false};
    std::vector<StageTime> stages_;
    std::string stage_;
    Clock::time_point stage_start_{};
    Clock::time_point last_call_{};
    bool in_stage_ = false;
    double first_ = 0.0, last_ = 1.0;
    double done_ = 0.0;  ///< of the stage
};

}  // namespace pointmorph
