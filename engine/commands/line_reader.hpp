#pragma once
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace tribode {

// Lines from standard input: with editing, history and completion where it is a terminal and libedit is there, else as they
// come, without a prompt.
class LineReader {
  public:
    // Whole words that may stand in place of the last one of the text before the cursor.
    using Complete = std::function<std::vector<std::string>(std::string_view text)>;

    // The history is kept in a file where a name is given.
    LineReader(Complete complete, std::filesystem::path history);
    ~LineReader();
    LineReader(const LineReader&) = delete;
    LineReader& operator=(const LineReader&) = delete;

    enum class Result { line, interrupted, end };
    // Interrupted: by a signal whose handler returns; what was typed is gone.
    Result read(const std::string& prompt, std::string& line);

    bool is_terminal() const { return terminal_; }

  private:
    struct Editor;

    bool terminal_;
    std::unique_ptr<Editor> editor_; // null: none
};

} // namespace tribode
