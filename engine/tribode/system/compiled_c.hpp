#pragma once
#include <filesystem>
#include <memory>
#include <string>

namespace tribode {

// Text of a C program made into machine code by the system's C compiler.
struct CCompiler {
    std::string command = "cc";  // as the shell finds it
    std::filesystem::path cache; // empty: usual_cache()

    // $XDG_CACHE_HOME/tribode, else ~/.cache/tribode. Throws Error where neither is known.
    static std::filesystem::path usual_cache();

    // What the compiler has made of a text before is taken from the cache, whose files are named by the SHA-256 of text,
    // flags and kind of machine. Any number of processes may share a cache, and it may be deleted at any time; it must
    // belong to this user alone, since what lies there is run. Throws Error where there is no compiler, it refuses the
    // text, or the cache cannot be used.
    class Library;
    std::shared_ptr<const Library> load(const std::string& text) const;
};

// Machine code in this process, as long as the object lives.
class CCompiler::Library {
  public:
    explicit Library(const std::filesystem::path& file); // throws Error
    ~Library();
    Library(const Library&) = delete;
    Library& operator=(const Library&) = delete;

    void* function(const std::string& name) const; // throws Error

  private:
    std::filesystem::path file_;
    void* handle_;
};

} // namespace tribode
