#include "tribode/base/error.hpp"
#include "tribode/script/lua_function.hpp"
#include "tribode/script/lua_reference.hpp"
#include "unit/script/temporary_folder.hpp"

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <gtest/gtest.h>
#include <sstream>

namespace tribode {
namespace {

namespace fs = std::filesystem;

std::string read(const fs::path& file) {
    std::ostringstream text;
    text << std::ifstream(file, std::ios::binary).rdbuf();
    return text.str();
}

const fs::path docs = fs::path(TRIBODE_SOURCE_DIR) / "docs";

TEST(LuaReference, tables_on_pages_are_those_of_the_code) {
    const bool update = std::getenv("TRIBODE_UPDATE_PAGES") != nullptr;
    int found = 0;
    for (const auto& entry : fs::directory_iterator(docs)) {
        if (entry.path().extension() != ".md") continue;
        const std::string page = read(entry.path()), made = with_tables(page);
        found += page.find("<!-- options: ") != std::string::npos;
        if (update && made != page) std::ofstream(entry.path(), std::ios::binary) << made;
        EXPECT_TRUE(made == page || update)
            << entry.path() << " is not what the code says. Run\n  TRIBODE_UPDATE_PAGES=1 test_script "
            << "--gtest_filter=LuaReference.*\nwhich writes it, and commit the page.";
    }
    EXPECT_EQ(found, 2); // lua-reference.md and systems.md
}

TEST(LuaReference, a_change_of_a_table_is_noticed) {
    const std::string page = read(docs / "lua-reference.md");
    std::string changed = page;
    const auto place = changed.find("| `tb.linspace(from, to, count)` |");
    ASSERT_NE(place, std::string::npos);
    changed.replace(place, 13, "| `tb.linspax");
    EXPECT_EQ(with_tables(changed), with_tables(page));
    EXPECT_NE(with_tables(changed), changed);
    std::string other = page;
    const auto option = other.find("| `amplitude_N` | N |");
    ASSERT_NE(option, std::string::npos);
    other.replace(option, 21, "| `amplitude_N` | m |");
    EXPECT_EQ(with_tables(other), with_tables(page));
    EXPECT_THROW(with_tables("<!-- options: tb.linspace -->\n<!-- end -->\n"), Error);
    EXPECT_THROW(with_tables("<!-- functions: tb.simulat -->\n<!-- end -->\n"), Error);
    EXPECT_THROW(with_tables("<!-- functions: tb.simulate -->\n"), Error);
}

// Every field of the module, functions and values, is on the page once, and everything on the page is there.
TEST(LuaReference, has_every_function_of_the_module_once) {
    const TemporaryFolder folder;
    std::ofstream(folder.path() / "s.lua") << "return nil\n";
    ScriptRequest request;
    request.script = folder.path() / "s.lua";
    request.folder = folder.path() / "out";
    ScriptRun run(request, {});
    const Json listed = run.lua().run_text(
        "local names = {}\n"
        "for name, value in pairs(require 'tribode') do\n"
        "  if name ~= 'parts' then names[#names + 1] = 'tb.' .. name end\n"
        "end\n"
        "for name in pairs(require('tribode').parts) do names[#names + 1] = 'tb.parts.' .. name end\n"
        "return names",
        "list");
    auto names = listed.get<std::vector<std::string>>();
    std::sort(names.begin(), names.end());
    ASSERT_GT(names.size(), 60u);
    auto on_page = functions_on(read(docs / "lua-reference.md"));
    std::sort(on_page.begin(), on_page.end());
    EXPECT_EQ(on_page, names);
    const std::string all_pages = read(docs / "lua-reference.md") + read(docs / "systems.md");
    for (const auto& function : all_functions()) {
        EXPECT_FALSE(function.documentation.empty()) << function.name;
        EXPECT_EQ(function.usage.front(), '`') << function.name;
        if (!function.options) continue;
        EXPECT_NE(all_pages.find("<!-- options: tb." + function.name + " -->"), std::string::npos) << function.name;
    }
}

} // namespace
} // namespace tribode
