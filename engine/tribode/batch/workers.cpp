#include "tribode/batch/workers.hpp"
#include "tribode/base/error.hpp"
#include "tribode/batch/batch_files.hpp"
#include "tribode/batch/shard_file.hpp"

#include <algorithm>
#include <atomic>
#include <cerrno>
#include <csignal>
#include <cstdio>
#include <cstring>
#include <ctime>
#include <deque>
#include <fcntl.h>
#include <fmt/format.h>
#include <map>
#include <new>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>
#include <utility>

namespace tribode {

namespace fs = std::filesystem;

namespace {

enum class ShardEnd : int { complete = 0, stopped = 10, not_written = 11, wrong_input = 12 };

// What a worker tells the one that started it, in memory that both see, also after the worker's death.
struct Notice {
    std::atomic<std::size_t> point{0}; // that is running; 0: none
    std::atomic<std::size_t> done{0};  // points of the shard so far
    char text[2048] = "";              // why it could not go on
};

class NoticeBoard {
  public:
    explicit NoticeBoard(std::size_t count) : bytes_(count * sizeof(Notice)) {
        void* memory = ::mmap(nullptr, bytes_, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
        if (memory == MAP_FAILED) throw Error("there is no memory for the workers' notices");
        notices_ = new (memory) Notice[count];
    }
    ~NoticeBoard() { ::munmap(notices_, bytes_); }
    NoticeBoard(const NoticeBoard&) = delete;
    NoticeBoard& operator=(const NoticeBoard&) = delete;
    Notice& operator[](std::size_t i) { return notices_[i]; }

  private:
    std::size_t bytes_;
    Notice* notices_;
};

bool is_crash(int signal) {
    switch (signal) {
    case SIGSEGV:
    case SIGABRT:
    case SIGBUS:
    case SIGFPE:
    case SIGILL:
    case SIGSYS: return true;
    default: return false;
    }
}

constexpr int max_crashes = 2, max_kills = 8, max_starts_without_a_point = 20;

// Deaths of workers while a point ran.
struct Deaths {
    int crashes = 0, kills = 0;
    std::string last;
    bool given_up() const { return crashes >= max_crashes || kills >= max_kills; }
};

struct Worker {
    pid_t process = 0; // 0: none
    std::size_t shard = 0;
};

class Pool {
  public:
    Pool(const fs::path& folder, const Manifest& manifest, const Batch& batch, const std::vector<std::size_t>& shards,
         const RunControl& control)
        : folder_(folder),
          manifest_(manifest),
          batch_(batch),
          control_(control),
          open_(shards.begin(), shards.end()),
          workers_(std::clamp<std::size_t>(control.workers, 1, std::max<std::size_t>(shards.size(), 1))),
          board_(workers_.size()) {
        std::size_t others = manifest.count;
        for (const std::size_t shard : shards) others -= manifest.range(shard).size();
        done_ = others;
        // A child's end is waited for with sigtimedwait; blocked, so that none is missed in between.
        sigemptyset(&child_ends_);
        sigaddset(&child_ends_, SIGCHLD);
        sigprocmask(SIG_BLOCK, &child_ends_, &mask_before_);
    }

    ~Pool() {
        for (auto& worker : workers_) {
            if (!worker.process) continue;
            ::kill(worker.process, SIGKILL);
            ::waitpid(worker.process, nullptr, 0);
        }
        sigprocmask(SIG_SETMASK, &mask_before_, nullptr);
    }
    Pool(const Pool&) = delete;
    Pool& operator=(const Pool&) = delete;

    bool run() {
        show();
        for (;;) {
            bool busy = false;
            for (std::size_t w = 0; w < workers_.size(); ++w) {
                if (!workers_[w].process && !open_.empty() && !ending()) start(w);
                busy = busy || workers_[w].process;
            }
            if (!busy) break;
            if (ending()) ask_to_end();
            const timespec patience{0, 200'000'000};
            sigtimedwait(&child_ends_, nullptr, &patience);
            for (std::size_t w = 0; w < workers_.size(); ++w) collect(w);
            show();
        }
        if (problem_) std::rethrow_exception(problem_);
        return open_.empty() && !interrupted_;
    }

  private:
    bool ending() const { return problem_ || control_.stop_requested(); }

    void ask_to_end() {
        for (auto& worker : workers_) {
            if (worker.process && !asked_) ::kill(worker.process, SIGTERM);
        }
        asked_ = true;
    }

    void start(std::size_t w) {
        const std::size_t shard = open_.front();
        std::fflush(nullptr); // else both processes would write what is buffered
        Notice& notice = board_[w];
        notice.point = 0;
        notice.done = 0;
        notice.text[0] = '\0';
        const pid_t parent = ::getpid();
        const pid_t process = ::fork();
        if (process < 0) throw Error(fmt::format("no process can be made ({})", std::strerror(errno)));
        if (process == 0) {
            // A worker does not outlive the one that started it, whatever ends that.
            ::prctl(PR_SET_PDEATHSIG, SIGKILL);
            if (::getppid() != parent) ::_exit(static_cast<int>(ShardEnd::stopped));
            sigprocmask(SIG_SETMASK, &mask_before_, nullptr);
            const ShardEnd end = work(shard, notice);
            std::fflush(nullptr);
            ::_exit(static_cast<int>(end));
        }
        open_.pop_front();
        workers_[w] = {process, shard};
    }

    // In the worker.
    ShardEnd work(std::size_t shard, Notice& notice) const {
        const auto say = [&notice](const char* text) { std::strncpy(notice.text, text, sizeof notice.text - 1); };
        try {
            // By another, meanwhile.
            if (shard_state(folder_, manifest_, shard).complete) return ShardEnd::complete;
            ShardWriter writer(folder_, manifest_, shard);
            const std::size_t before = writer.next_index();
            while (!writer.complete()) {
                if (control_.stop_requested()) return ShardEnd::stopped;
                const std::size_t index = writer.next_index();
                notice.point.store(index, std::memory_order_relaxed);
                notice.done.store(index - manifest_.range(shard).first, std::memory_order_relaxed);
                const auto deaths = deaths_.find(index);
                if (deaths != deaths_.end()) writer.flush(); // its points are kept if it dies again
                if (deaths != deaths_.end() && deaths->second.given_up()) {
                    writer.add({index, batch_.point(index), deaths->second.last, {}});
                } else {
                    writer.add(batch_.run(index));
                }
                if (index == before) writer.flush(); // a start that leaves a point is progress
            }
            notice.point = 0;
            writer.finish();
            return ShardEnd::complete;
        } catch (const EndedEarly&) {
            return ShardEnd::stopped;
        } catch (const OutputError& problem) {
            say(problem.what());
            return ShardEnd::not_written;
        } catch (const std::exception& problem) {
            say(problem.what());
            return ShardEnd::wrong_input;
        }
    }

    void collect(std::size_t w) {
        Worker& worker = workers_[w];
        int status = 0;
        if (!worker.process || ::waitpid(worker.process, &status, WNOHANG) != worker.process) return;
        const std::size_t shard = worker.shard;
        worker = {};
        if (WIFEXITED(status)) {
            switch (static_cast<ShardEnd>(WEXITSTATUS(status))) {
            case ShardEnd::complete: done_ += manifest_.range(shard).size(); return;
            case ShardEnd::stopped: interrupted_ = true; return;
            case ShardEnd::not_written: return fail(OutputError(board_[w].text));
            case ShardEnd::wrong_input: return fail(InputError(board_[w].text));
            }
        }
        if (ending()) {
            interrupted_ = true;
            return;
        }
        blame(shard, board_[w].point, status);
        open_.push_front(shard);
    }

    // The point that ran when its process died.
    void blame(std::size_t shard, std::size_t point, int status) {
        if (point == 0) {
            if (++starts_without_a_point_[shard] >= max_starts_without_a_point) {
                fail(Error(fmt::format("the process of shard {} died {} times before its first point", shard,
                                       max_starts_without_a_point)));
            }
            return;
        }
        Deaths& deaths = deaths_[point];
        if (WIFEXITED(status)) {
            ++deaths.crashes;
            deaths.last = fmt::format("the point ended its process with exit code {}", WEXITSTATUS(status));
            return;
        }
        const int signal = WTERMSIG(status);
        ++(is_crash(signal) ? deaths.crashes : deaths.kills);
        deaths.last = is_crash(signal)
                          ? fmt::format("the point crashed its process (signal {}, {})", signal, strsignal(signal))
                          : fmt::format("the process was killed {} times while the point ran (signal {}; out of "
                                        "memory?)",
                                        max_kills, signal);
    }

    template <class Problem>
    void fail(Problem problem) {
        if (!problem_) problem_ = std::make_exception_ptr(std::move(problem));
    }

    void show() {
        if (!control_.progress) return;
        std::size_t now = done_;
        for (std::size_t w = 0; w < workers_.size(); ++w) {
            if (workers_[w].process) now += board_[w].done.load(std::memory_order_relaxed);
        }
        // A shard begun anew has fewer points than it had; the bar does not go back.
        shown_ = std::max(shown_, now);
        control_.progress(batch_.name, shown_, manifest_.count);
    }

    const fs::path& folder_;
    const Manifest& manifest_;
    const Batch& batch_;
    const RunControl& control_;
    std::deque<std::size_t> open_; // shards
    std::vector<Worker> workers_;
    NoticeBoard board_;
    sigset_t child_ends_{}, mask_before_{};
    std::map<std::size_t, Deaths> deaths_;              // by point
    std::map<std::size_t, int> starts_without_a_point_; // by shard
    std::size_t done_ = 0, shown_ = 0;                  // points
    bool asked_ = false, interrupted_ = false;
    std::exception_ptr problem_;
};

} // namespace

FolderLock::FolderLock(const fs::path& folder) {
    const fs::path path = folder / "lock";
    file_ = ::open(path.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0666);
    if (file_ < 0) {
        throw OutputError(fmt::format("{}: cannot be written ({})", path.string(), std::strerror(errno)));
    }
    // A lock of fcntl, because it is not passed on by fork: workers that live a moment longer do not hold it.
    struct flock whole {};
    whole.l_type = F_WRLCK;
    whole.l_whence = SEEK_SET;
    if (::fcntl(file_, F_SETLK, &whole) == 0) return;
    const int reason = errno;
    const bool known = ::fcntl(file_, F_GETLK, &whole) == 0 && whole.l_type != F_UNLCK && whole.l_pid > 0;
    ::close(std::exchange(file_, -1));
    if (reason != EACCES && reason != EAGAIN) return; // a file system without locks: work may be done twice, no more
    throw InputError(fmt::format("{}: another process{} is at work on this batch; wait for it or end it, then resume",
                                 folder.string(), known ? fmt::format(" ({})", whole.l_pid) : ""));
}

FolderLock::~FolderLock() {
    if (file_ >= 0) ::close(file_);
}

bool run_shards(const fs::path& folder, const Manifest& manifest, const Batch& batch,
                const std::vector<std::size_t>& shards, const RunControl& control) {
    return Pool(folder, manifest, batch, shards, control).run();
}

} // namespace tribode
