#include "commands/line_reader.hpp"

#include <algorithm>
#include <cctype>
#include <cerrno>
#include <clocale>
#include <cstdio>
#include <cwchar>
#include <sys/stat.h>
#include <unistd.h>

#ifdef TRIBODE_LIBEDIT
#include <histedit.h>
#endif

namespace tribode {

#ifdef TRIBODE_LIBEDIT

struct LineReader::Editor {
    EditLine* edit = nullptr;
    History* history = nullptr;
    std::filesystem::path file;
    Complete complete;
    std::string prompt;

    // A character, as libedit wants it. Its own function goes on after a signal.
    static int read_character(EditLine*, wchar_t* character) {
        std::mbstate_t state{};
        for (;;) {
            char byte = 0;
            const ssize_t got = ::read(STDIN_FILENO, &byte, 1);
            if (got <= 0) return static_cast<int>(got); // also where a signal came: no character
            const std::size_t used = std::mbrtowc(character, &byte, 1, &state);
            if (used == static_cast<std::size_t>(-2)) continue; // the character has more bytes
            if (used == static_cast<std::size_t>(-1)) *character = L'?';
            return 1;
        }
    }

    static Editor& of(EditLine* edit) {
        void* self = nullptr;
        el_get(edit, EL_CLIENTDATA, &self);
        return *static_cast<Editor*>(self);
    }

    static unsigned char on_tab(EditLine* edit, int) {
        Editor& self = of(edit);
        const LineInfo* line = el_line(edit);
        const std::string_view before(line->buffer, static_cast<std::size_t>(line->cursor - line->buffer));
        const auto words = self.complete(before);
        if (words.empty()) return CC_REFRESH_BEEP;
        std::size_t common = words[0].size();
        for (const auto& word : words) {
            const auto differ = std::mismatch(word.begin(), word.end(), words[0].begin(), words[0].end()).first;
            common = std::min(common, static_cast<std::size_t>(differ - word.begin()));
        }
        // The longest end of the line that the words begin with is what they replace.
        std::size_t typed = std::min(common, before.size());
        while (!before.ends_with(std::string_view(words[0]).substr(0, typed))) --typed;
        if (typed < common) {
            el_insertstr(edit, words[0].substr(typed, common - typed).c_str());
            return CC_REFRESH;
        }
        if (words.size() == 1) return CC_REFRESH;
        std::fputc('\n', stdout);
        for (const auto& word : words) std::printf("%s  ", word.c_str());
        std::fputc('\n', stdout);
        std::fflush(stdout);
        return CC_REDISPLAY;
    }

    static char* prompt_of(EditLine* edit) { return of(edit).prompt.data(); }
};

LineReader::LineReader(Complete complete, std::filesystem::path history)
    : terminal_(isatty(STDIN_FILENO) && isatty(STDOUT_FILENO)) {
    if (!terminal_) return;
    std::setlocale(LC_CTYPE, "C.UTF-8");
    editor_ = std::make_unique<Editor>();
    editor_->complete = std::move(complete);
    editor_->file = std::move(history);
    editor_->edit = el_init("tribode", stdin, stdout, stderr);
    editor_->history = history_init();
    if (!editor_->edit || !editor_->history) {
        editor_.reset();
        return;
    }
    HistEvent event;
    ::history(editor_->history, &event, H_SETSIZE, 1000);
    ::history(editor_->history, &event, H_SETUNIQUE, 1);
    if (!editor_->file.empty()) ::history(editor_->history, &event, H_LOAD, editor_->file.c_str());
    EditLine* edit = editor_->edit;
    el_set(edit, EL_CLIENTDATA, editor_.get());
    el_set(edit, EL_PROMPT, &Editor::prompt_of);
    el_set(edit, EL_EDITOR, "emacs");
    el_set(edit, EL_HIST, ::history, editor_->history);
    el_set(edit, EL_GETCFN, &Editor::read_character);
    el_set(edit, EL_ADDFN, "complete", "completes a name", &Editor::on_tab);
    el_set(edit, EL_BIND, "^I", "complete", nullptr);
    el_set(edit, EL_BIND, "^R", "em-inc-search-prev", nullptr);
    el_source(edit, nullptr); // ~/.editrc
}

LineReader::~LineReader() {
    if (!editor_) return;
    HistEvent event;
    if (!editor_->file.empty()) {
        ::umask(S_IRWXG | S_IRWXO);
        ::history(editor_->history, &event, H_SAVE, editor_->file.c_str());
    }
    history_end(editor_->history);
    el_end(editor_->edit);
}

#else

struct LineReader::Editor {};
LineReader::LineReader(Complete, std::filesystem::path) : terminal_(isatty(STDIN_FILENO) && isatty(STDOUT_FILENO)) {}
LineReader::~LineReader() = default;

#endif

LineReader::Result LineReader::read(const std::string& prompt, std::string& line) {
#ifdef TRIBODE_LIBEDIT
    if (editor_) {
        editor_->prompt = prompt;
        int count = 0;
        errno = 0;
        const char* text = el_gets(editor_->edit, &count);
        if (!text || count <= 0) {
            if (errno != EINTR) return Result::end;
            el_reset(editor_->edit);
            return Result::interrupted;
        }
        line.assign(text, static_cast<std::size_t>(count));
        HistEvent event;
        if (line != "\n") ::history(editor_->history, &event, H_ENTER, line.c_str());
        while (line.ends_with('\n') || line.ends_with('\r')) line.pop_back();
        return Result::line;
    }
#endif
    if (terminal_) {
        std::printf("%s", prompt.c_str());
        std::fflush(stdout);
    }
    line.clear();
    for (;;) {
        char byte = 0;
        const ssize_t got = ::read(STDIN_FILENO, &byte, 1);
        if (got < 0 && errno == EINTR) return Result::interrupted;
        if (got <= 0) return line.empty() ? Result::end : Result::line;
        if (byte == '\n') return Result::line;
        line += byte;
    }
}

} // namespace tribode
