#include "engine_call.hpp"

#include <csignal>
#include <unistd.h>

namespace tribode::python {

namespace {

std::atomic<std::atomic<bool>*> watched{nullptr};
struct sigaction pythons_action;

void on_interrupt(int signal) {
    if (std::atomic<bool>* stop = watched) *stop = true;
    pythons_action.sa_handler(signal);
}

} // namespace

InterruptWatch::InterruptWatch(std::atomic<bool>& stop) {
    // Python runs its handlers in the main thread, and so raises KeyboardInterrupt only there.
    if (::gettid() != ::getpid()) return;
    struct sigaction now {};
    if (::sigaction(SIGINT, nullptr, &now) != 0) return;
    const bool nested = now.sa_handler == on_interrupt; // in a progress function
    if (!nested) {
        // None of Python's: the program that embeds it wants Ctrl-C to do something else.
        if ((now.sa_flags & SA_SIGINFO) || now.sa_handler == SIG_DFL || now.sa_handler == SIG_IGN) return;
        pythons_action = now;
    }
    watching_ = true;
    before_ = watched.exchange(&stop);
    if (nested) return;
    struct sigaction ours = now;
    ours.sa_handler = on_interrupt;
    installed_ = ::sigaction(SIGINT, &ours, nullptr) == 0;
}

InterruptWatch::~InterruptWatch() {
    if (!watching_) return;
    if (installed_) ::sigaction(SIGINT, &pythons_action, nullptr);
    watched = before_;
}

EngineCall::EngineCall(nb::handle progress, unsigned workers) {
    control_.stop = &stop_;
    control_.workers = workers;
    if (progress.is_none()) return;
    progress_ = nb::borrow(progress);
    control_.progress = [this](const std::string& what, std::size_t done, std::size_t of) {
        const nb::gil_scoped_acquire held;
        if (failure_) return;
        try {
            progress_(nb::str(what.data(), what.size()), done, of);
        } catch (nb::python_error& error) {
            failure_.emplace(std::move(error));
            stop_ = true;
        }
    };
}

void EngineCall::raise_pending() {
    if (PyErr_CheckSignals() != 0) throw nb::python_error();
    if (!failure_) return;
    failure_->restore();
    failure_.reset();
    throw nb::python_error();
}

} // namespace tribode::python
