#include "structure/modules.hpp"
#include "structure/tree.hpp"

#include <gtest/gtest.h>

namespace tribode::structure {
namespace {

namespace fs = std::filesystem;

const Modules& modules() {
    static const Modules all = Modules::from_markdown(read(project() / "docs/modules.md"));
    return all;
}

const char* const made_up_tables = "| module | holds | may use |\n|---|---|---|\n"
                                   "| base | a | – |\n| middle | b | base |\n| top | c | middle |\n\n"
                                   "| package | headers beginning with | only in |\n|---|---|---|\n"
                                   "| P | p/ q.h | middle |\n";

TEST(Modules, TheTableSaysWhatAModuleMayUseAndWhatThoseUse) {
    const Modules made_up = Modules::from_markdown(made_up_tables);
    EXPECT_EQ(made_up.may_use.at("base"), std::set<std::string>{});
    EXPECT_EQ(made_up.reachable("top"), (std::set<std::string>{"top", "middle", "base"}));
    EXPECT_EQ(made_up.reachable("base"), std::set<std::string>{"base"});
    EXPECT_EQ(made_up.only_in.at("q.h"), std::set<std::string>{"middle"});
    EXPECT_THROW(Modules::from_markdown("no table here"), std::runtime_error);
}

TEST(Modules, AnIncludeAgainstTheDependenciesIsReportedWithItsLine) {
    const Modules made_up = Modules::from_markdown(made_up_tables);
    EXPECT_EQ(
        violations(made_up, "tribode/base/x.cpp", "#pragma once\n #  include \"tribode/top/y.hpp\"\n"),
        std::vector<std::string>{"engine/tribode/base/x.cpp:2 includes tribode/top/y.hpp, but base may not use top"});
    EXPECT_EQ(violations(made_up, "tribode/top/x.cpp", "#include \"../base/y.hpp\"\n").size(), 1u);
    EXPECT_EQ(violations(made_up, "tribode/top/x.cpp", "#include <p/y.h>\n"),
              std::vector<std::string>{"engine/tribode/top/x.cpp:1 includes p/y.h, which belongs in middle alone"});
    EXPECT_EQ(violations(made_up, "main.cpp", "#include <q.h>\n").size(), 1u);
    EXPECT_EQ(
        violations(made_up, "main.cpp", "#include \"tribode/base/y.hpp\"\n#include \"tribode/top/y.hpp\"\n").size(),
        0u);
    EXPECT_EQ(violations(made_up, "tribode/middle/x.cpp", "#include <p/y.h>\n#include \"tribode/base/y.hpp\"\n").size(),
              0u);
}

TEST(Modules, DependenciesGoOneWay) {
    for (const auto& [module, used] : modules().may_use) {
        for (const auto& other : used) {
            EXPECT_TRUE(modules().may_use.contains(other)) << module << " may use " << other << ", which has no row";
            EXPECT_FALSE(modules().reachable(other).contains(module))
                << module << " and " << other << " use each other";
        }
    }
}

TEST(Modules, EveryFolderOfTheEngineHasARowAndEveryRowAFolder) {
    std::set<std::string> folders, rows;
    for (const auto& entry : fs::directory_iterator(project() / "engine/tribode")) {
        if (entry.is_directory()) folders.insert(entry.path().filename().string());
    }
    for (const auto& [module, used] : modules().may_use) rows.insert(module);
    EXPECT_EQ(folders, rows);
}

TEST(Modules, TheEngineIncludesOnlyWhatTheTablesAllow) {
    const auto sources = files_below("engine", {".cpp", ".hpp"});
    ASSERT_GT(sources.size(), 20u) << "the engine was not found";
    for (const auto& file : sources) {
        for (const auto& text : violations(modules(), file.lexically_relative(project() / "engine"), read(file))) {
            ADD_FAILURE() << text;
        }
    }
}

TEST(Modules, TheLinkLinesAgreeWithTheTable) {
    EXPECT_EQ(link_lines("function(tribode_module name)\ntribode_module(a fmt::fmt tribode_b\n  tribode_c)\n"),
              (std::map<std::string, std::set<std::string>>{{"a", {"b", "c"}}}));
    EXPECT_EQ(link_lines(read(project() / "engine/CMakeLists.txt")), modules().may_use);
}

} // namespace
} // namespace tribode::structure
