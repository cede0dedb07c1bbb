#include "house/rooms.hpp"
#include "house/tree.hpp"

#include <gtest/gtest.h>

namespace tribode::house {
namespace {

namespace fs = std::filesystem;

const Rooms& rooms() {
    static const Rooms all = Rooms::from_markdown(read(project() / "docs/rooms.md"));
    return all;
}

const char* const made_up_tables = "| room | holds | may use |\n|---|---|---|\n"
                                   "| base | a | – |\n| middle | b | base |\n| top | c | middle |\n\n"
                                   "| package | headers beginning with | only in |\n|---|---|---|\n"
                                   "| P | p/ q.h | middle |\n";

TEST(Rooms, TheTableSaysWhatARoomMayUseAndWhatThoseUse) {
    const Rooms made_up = Rooms::from_markdown(made_up_tables);
    EXPECT_EQ(made_up.may_use.at("base"), std::set<std::string>{});
    EXPECT_EQ(made_up.reachable("top"), (std::set<std::string>{"top", "middle", "base"}));
    EXPECT_EQ(made_up.reachable("base"), std::set<std::string>{"base"});
    EXPECT_EQ(made_up.only_in.at("q.h"), "middle");
    EXPECT_THROW(Rooms::from_markdown("no table here"), std::runtime_error);
}

TEST(Rooms, AnIncludeAgainstTheArrowsIsReportedWithItsLine) {
    const Rooms made_up = Rooms::from_markdown(made_up_tables);
    EXPECT_EQ(violations(made_up, "base/x.cpp", "#pragma once\n #  include \"top/y.hpp\"\n"),
              std::vector<std::string>{"engine/base/x.cpp:2 includes top/y.hpp, but base may not use top"});
    EXPECT_EQ(violations(made_up, "top/x.cpp", "#include \"../base/y.hpp\"\n").size(), 1u);
    EXPECT_EQ(violations(made_up, "top/x.cpp", "#include <p/y.h>\n"),
              std::vector<std::string>{"engine/top/x.cpp:1 includes p/y.h, which belongs in middle alone"});
    EXPECT_EQ(violations(made_up, "main.cpp", "#include <q.h>\n").size(), 1u);
    EXPECT_EQ(violations(made_up, "main.cpp", "#include \"base/y.hpp\"\n#include \"top/y.hpp\"\n").size(), 0u);
    EXPECT_EQ(violations(made_up, "middle/x.cpp", "#include <p/y.h>\n#include \"base/y.hpp\"\n").size(), 0u);
}

TEST(Rooms, TheArrowsGoOneWay) {
    for (const auto& [room, used] : rooms().may_use) {
        for (const auto& other : used) {
            EXPECT_TRUE(rooms().may_use.contains(other)) << room << " may use " << other << ", which has no row";
            EXPECT_FALSE(rooms().reachable(other).contains(room)) << room << " and " << other << " use each other";
        }
    }
}

TEST(Rooms, EveryFolderOfTheEngineHasARowAndEveryRowAFolder) {
    std::set<std::string> folders, rows;
    for (const auto& entry : fs::directory_iterator(project() / "engine")) {
        if (entry.is_directory()) folders.insert(entry.path().filename().string());
    }
    for (const auto& [room, used] : rooms().may_use) rows.insert(room);
    EXPECT_EQ(folders, rows);
}

TEST(Rooms, TheEngineIncludesOnlyWhatTheTablesAllow) {
    const auto sources = files_below("engine", {".cpp", ".hpp"});
    ASSERT_GT(sources.size(), 20u) << "the engine was not found";
    for (const auto& file : sources) {
        for (const auto& text : violations(rooms(), file.lexically_relative(project() / "engine"), read(file))) {
            ADD_FAILURE() << text;
        }
    }
}

TEST(Rooms, TheLinkLinesAgreeWithTheTable) {
    EXPECT_EQ(link_lines("function(tribode_room name)\ntribode_room(a fmt::fmt tribode_b\n  tribode_c)\n"),
              (std::map<std::string, std::set<std::string>>{{"a", {"b", "c"}}}));
    EXPECT_EQ(link_lines(read(project() / "engine/CMakeLists.txt")), rooms().may_use);
}

} // namespace
} // namespace tribode::house
