#pragma once
#include "tribode/script/script_run.hpp"

#include <string>
#include <string_view>
#include <vector>

namespace tribode {

// A script that is written while it runs. It has the module as the global tb.
class Dialogue {
  public:
    explicit Dialogue(ScriptRun& run);

    // Runs an expression, whose values are printed, or statements. False where the text is a beginning that goes on in the
    // next line; it then has done nothing. Throws what a script does; an interruption or a limit ends this text only.
    bool evaluate(const std::string& text);

    // What the name before the end of the text may go on as: whole names, "tb.simulate". Looks at globals and fields of
    // tables; runs nothing.
    std::vector<std::string> completions(std::string_view text);

  private:
    ScriptRun& run_;
    LuaState& lua_;
};

} // namespace tribode
