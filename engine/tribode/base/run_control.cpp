#include "tribode/base/run_control.hpp"

#include <algorithm>
#include <exception>
#include <mutex>
#include <thread>
#include <vector>

namespace tribode {

std::size_t for_each_index(std::size_t count, const RunControl& control, const std::string& what,
                           const std::function<void(std::size_t)>& run) {
    std::atomic<std::size_t> next{0};
    std::atomic<bool> failed{false};
    std::mutex mutex; // guards `done`, `problem` and the progress display
    std::size_t done = 0;
    std::exception_ptr problem;

    const auto work = [&] {
        while (!failed && !control.stop_requested()) {
            const std::size_t i = next++;
            if (i >= count) return;
            try {
                run(i);
                const std::lock_guard lock(mutex);
                ++done;
                if (control.progress) control.progress(what, done, count);
            } catch (...) {
                const std::lock_guard lock(mutex);
                if (!problem) problem = std::current_exception();
                failed = true;
                return;
            }
        }
    };

    const std::size_t workers = std::clamp<std::size_t>(control.workers, 1, std::max<std::size_t>(count, 1));
    {
        std::vector<std::jthread> others;
        for (std::size_t w = 1; w < workers; ++w) others.emplace_back(work);
        work();
    }
    if (problem) std::rethrow_exception(problem);
    return done;
}

} // namespace tribode
