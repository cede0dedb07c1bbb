#include "tribode/base/kernel_sandbox.hpp"
#include "unit/script/temporary_folder.hpp"

#include <cerrno>
#include <csignal>
#include <fcntl.h>
#include <functional>
#include <gtest/gtest.h>
#include <new>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <thread>
#include <unistd.h>
#include <vector>

namespace tribode {
namespace {

namespace fs = std::filesystem;

constexpr int unconfined = 77, failed = 1; // exit codes of a child

// What a copy of this process ends with that has entered the sandbox.
int inside(const KernelSandbox& sandbox, const std::function<bool()>& work) {
    const pid_t child = ::fork();
    if (child == 0) {
        if (!sandbox.enter()) ::_exit(unconfined);
        ::_exit(work() ? 0 : failed);
    }
    int status = 0;
    ::waitpid(child, &status, 0);
    return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
}

bool kernel_has_it() {
    return inside({}, [] { return true; }) != unconfined;
}

bool may_read(const fs::path& file) {
    const int number = ::open(file.c_str(), O_RDONLY | O_CLOEXEC);
    if (number >= 0) ::close(number);
    return number >= 0;
}

bool may_write(const fs::path& file) {
    const int number = ::open(file.c_str(), O_WRONLY | O_CREAT | O_CLOEXEC, 0666);
    if (number >= 0) ::close(number);
    return number >= 0;
}

bool may_start(const char* program) {
    const pid_t child = ::fork();
    if (child == 0) {
        ::execlp(program, program, "/dev/null", nullptr);
        ::_exit(failed);
    }
    int status = 0;
    ::waitpid(child, &status, 0);
    return WIFEXITED(status) && WEXITSTATUS(status) == 0;
}

class Sandbox : public ::testing::Test {
  protected:
    void SetUp() override {
        if (!kernel_has_it()) GTEST_SKIP() << "this kernel has no Landlock";
        fs::create_directory(root / "run");
        folder.write("named.txt", "named");
        folder.write("secret.txt", "secret");
        folder.write("run/a.txt", "a");
    }

    TemporaryFolder folder;
    const fs::path& root = folder.path();
};

TEST_F(Sandbox, HasTheFilesItWasGivenAndNoOthers) {
    const KernelSandbox sandbox{.read = {root / "named.txt", root / "none"}, .write = {root / "run"}, .execute = {}};
    const auto holds = [&](const std::function<bool()>& work) { return inside(sandbox, work) == 0; };
    EXPECT_TRUE(holds([&] { return may_read(root / "named.txt") && !may_write(root / "named.txt"); }));
    EXPECT_TRUE(holds([&] { return may_read(root / "run/a.txt") && may_write(root / "run/b.txt"); }));
    EXPECT_TRUE(holds([&] { return !may_read(root / "secret.txt") && !may_write(root / "new.txt"); }));
    EXPECT_TRUE(holds([&] { return !may_read(root) && ::rmdir(root.c_str()) != 0; }));
    EXPECT_TRUE(holds([&] { return ::unlink((root / "secret.txt").c_str()) != 0; }));
    EXPECT_TRUE(holds([&] { // as shards do
        return ::mkdir((root / "run/parts").c_str(), 0777) == 0 && may_write(root / "run/parts/1") &&
               ::rename((root / "run/parts/1").c_str(), (root / "run/1").c_str()) == 0;
    }));
    EXPECT_TRUE(holds([&] {
        return ::link((root / "secret.txt").c_str(), (root / "run/link").c_str()) != 0 &&
               ::symlink((root / "secret.txt").c_str(), (root / "run/symlink").c_str()) != 0;
    }));
    EXPECT_TRUE(holds([&] { return may_write("/dev/null") && may_read("/dev/urandom"); }));
    EXPECT_TRUE(fs::exists(root / "secret.txt"));
}

TEST_F(Sandbox, StartsNoProgramButTheNamedOnes) {
    EXPECT_TRUE(may_start("cat"));
    KernelSandbox sandbox;
    EXPECT_EQ(inside(sandbox, [] { return !may_start("cat") && !may_start("sh"); }), 0);
    sandbox.allow_program("cat");
    sandbox.allow_program("no such program");
    EXPECT_EQ(inside(sandbox, [] { return may_start("cat") && !may_start("sh"); }), 0);
    EXPECT_EQ(inside(sandbox, [] { return std::system("true") != 0; }), 0); // the shell
}

TEST_F(Sandbox, HasNoNetwork) {
    EXPECT_EQ(inside({}, [] { return ::socket(AF_INET, SOCK_STREAM, 0) < 0 && errno == EACCES; }), 0);
    EXPECT_EQ(inside({}, [] { return ::socket(AF_UNIX, SOCK_STREAM, 0) < 0; }), 0);
}

TEST_F(Sandbox, HoldsInThreadsToo) {
    EXPECT_EQ(inside({},
                     [&] {
                         bool refused = false;
                         std::thread([&] { refused = !may_read(root / "secret.txt"); }).join();
                         return refused;
                     }),
              0);
}

TEST_F(Sandbox, AnOutputMayBeMadeWithItsFolder) {
    const auto outputs = [&](const fs::path& path) {
        KernelSandbox sandbox;
        sandbox.allow_output(path);
        return sandbox;
    };
    EXPECT_EQ(inside(outputs(root / "run/new/x.csv"),
                     [&] {
                         return ::mkdir((root / "run/new").c_str(), 0777) == 0 && may_write(root / "run/new/x.csv") &&
                                !may_write(root / "secret.txt");
                     }),
              0);
    EXPECT_EQ(inside(outputs("/dev/full"), [&] { return may_write("/dev/full") && !may_write(root / "y"); }), 0);
}

TEST(ProcessLimits, AreThoseOfTheProcess) {
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
    GTEST_SKIP() << "a sanitizer ends the program where there is no memory";
#endif
    const pid_t child = ::fork();
    if (child == 0) {
        limit_process(std::size_t{64} << 20, 0);
        try {
            std::vector<char> much(std::size_t{1} << 30, 'x');
            ::_exit(much[123] == 'x' ? failed : 2);
        } catch (const std::bad_alloc&) {
            ::_exit(0);
        }
    }
    int status = 0;
    ::waitpid(child, &status, 0);
    EXPECT_TRUE(WIFEXITED(status) && WEXITSTATUS(status) == 0);
    const pid_t endless = ::fork();
    if (endless == 0) {
        limit_process(0, 1);
        volatile bool on = true;
        while (on) {
        }
    }
    ::waitpid(endless, &status, 0);
    EXPECT_TRUE(WIFSIGNALED(status) && WTERMSIG(status) == SIGXCPU);
}

} // namespace
} // namespace tribode
