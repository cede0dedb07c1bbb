#include "structure/tree.hpp"

#include <algorithm>
#include <fmt/format.h>
#include <gtest/gtest.h>
#include <regex>
#include <sstream>

namespace tribode::structure {
namespace {

namespace fs = std::filesystem;

std::vector<fs::path> files_of_the_project(const std::set<std::string>& extensions) {
    std::vector<fs::path> all;
    for (const auto* folder : {"engine", "tests", "benchmarks", "models", "scripts", "docs", "examples"}) {
        const auto more = files_below(folder, extensions);
        all.insert(all.end(), more.begin(), more.end());
    }
    return all;
}

bool has_pragma_once(const std::string& text) { return text.starts_with("#pragma once\n"); }

// Targets of [text](target) outside of code, without those that lead to the network or within the page.
std::vector<std::string> relative_links(const std::string& page) {
    static const std::regex link(R"(\]\(([^)\s]+)[^)]*\))"), code(R"(`[^`]*`)");
    std::vector<std::string> targets;
    std::istringstream lines(page);
    bool in_code = false;
    for (std::string line; std::getline(lines, line);) {
        if (line.starts_with("```")) in_code = !in_code;
        if (in_code || line.starts_with("    ")) continue;
        line = std::regex_replace(line, code, "");
        for (std::sregex_iterator it(line.begin(), line.end(), link), end; it != end; ++it) {
            const std::string target = (*it)[1];
            if (target.find("://") == std::string::npos && !target.starts_with("#") && !target.starts_with("mailto:")) {
                targets.push_back(target.substr(0, target.find('#')));
            }
        }
    }
    return targets;
}

// The blocks of a page between ```language and ```.
std::vector<std::string> blocks_of(const std::string& page, const std::string& language) {
    std::vector<std::string> blocks;
    std::istringstream lines(page);
    bool inside = false;
    for (std::string line; std::getline(lines, line);) {
        if (inside && line == "```") {
            inside = false;
        } else if (inside) {
            blocks.back() += line + "\n";
        } else if (line == "```" + language) {
            inside = true;
            blocks.emplace_back();
        }
    }
    return blocks;
}

// Lines that speak of work to come. The words are put together here, so that this file has none.
std::vector<std::size_t> lines_with_open_ends(const std::string& text) {
    static const std::regex words("\\b(TO"
                                  "DO|FIX"
                                  "ME|X"
                                  "XX|TB"
                                  "D|HA"
                                  "CK|place"
                                  "holder|not yet impl"
                                  "emented)\\b");
    std::vector<std::size_t> found;
    std::istringstream lines(text);
    std::size_t number = 0;
    for (std::string line; std::getline(lines, line);) {
        ++number;
        if (std::regex_search(line, words)) found.push_back(number);
    }
    return found;
}

// The numbers of `NNNN-title.md`; a name of another form counts as 0.
std::vector<int> record_numbers(const std::vector<fs::path>& files) {
    static const std::regex form(R"((\d{4})-[a-z0-9-]+\.md)");
    std::vector<int> numbers;
    for (const auto& file : files) {
        const std::string name = file.filename().string();
        std::smatch match;
        numbers.push_back(std::regex_match(name, match, form) ? std::stoi(match[1]) : 0);
    }
    return numbers;
}

// Sources cited as [Author Year]; the year may be followed by a place, as in [Author 1999, section 2].
std::set<std::string> citations(const std::string& text) {
    static const std::regex citation(R"(\[([A-Z][^\]\[ \n]+ (?:18|19|20)\d\d|FRA paper)[\],])");
    std::set<std::string> found;
    for (std::sregex_iterator it(text.begin(), text.end(), citation), end; it != end; ++it) found.insert((*it)[1]);
    return found;
}

TEST(Files, EveryHeaderBeginsWithPragmaOnce) {
    EXPECT_FALSE(has_pragma_once("#include <vector>\n"));
    const auto headers = files_of_the_project({".hpp"});
    ASSERT_FALSE(headers.empty());
    for (const auto& file : headers) EXPECT_TRUE(has_pragma_once(read(file))) << file;
}

TEST(Files, DecisionsAreNumberedWithoutGaps) {
    EXPECT_EQ(record_numbers({"0001-a-b.md", "7-c.md"}), (std::vector{1, 0}));
    const auto numbers = record_numbers(files_below("docs/decisions", {".md"}));
    ASSERT_FALSE(numbers.empty());
    for (std::size_t i = 0; i < numbers.size(); ++i) EXPECT_EQ(numbers[i], static_cast<int>(i) + 1);
}

TEST(Files, EveryRelativeLinkOfAPageLeadsToAFile) {
    EXPECT_EQ(relative_links("[a](b.md#c) `[d](e.md)` [f](https://g.h) [i](#j)\n```\n[k](l.md)\n```\n[m](n.md)\n"),
              (std::vector<std::string>{"b.md", "n.md"}));
    for (const auto& page : pages()) {
        for (const auto& target : relative_links(read(page))) {
            EXPECT_TRUE(fs::exists(page.parent_path() / target)) << page << " links to " << target;
        }
    }
}

// Every file in docs/samples is run by other tests. So the blocks of the tutorial and of the how-to guides, and those of other
// pages that begin like a script, must be text of one of these files.
TEST(Files, ScriptsOnPagesAreTextOfSamples) {
    EXPECT_EQ(blocks_of("a\n```lua\nb\nc\n```\n```\nd\n```\n", "lua"), std::vector<std::string>{"b\nc\n"});
    std::vector<std::string> samples;
    for (const auto& file : files_below("docs/samples", {".lua"})) samples.push_back(read(file));
    int found = 0;
    for (const auto& page : pages()) {
        const bool is_guide = page.filename() == "tutorial.md" || page.parent_path().filename() == "how-to";
        for (const auto& block : blocks_of(read(page), "lua")) {
            if (!is_guide && block.find("require \"tribode\"") == std::string::npos) continue;
            const auto has_block = [&](const std::string& sample) { return sample.find(block) != std::string::npos; };
            EXPECT_TRUE(std::any_of(samples.begin(), samples.end(), has_block)) << page << ":\n" << block;
            ++found;
        }
    }
    EXPECT_GT(found, 10);
}

// The example is built and run against the installed package.
TEST(Files, TheCodeOfTheLibraryPageIsTextOfTheExample) {
    const std::string page = read(project() / "docs/library.md");
    const auto example = [](const char* file) { return read(project() / "examples/library" / file); };
    EXPECT_EQ(blocks_of(page, "cpp").size(), 2u);
    for (const auto& block : blocks_of(page, "cpp"))
        EXPECT_NE(example("example.cpp").find(block), std::string::npos) << block;
    EXPECT_EQ(blocks_of(page, "cmake").size(), 1u);
    for (const auto& block : blocks_of(page, "cmake")) {
        EXPECT_NE(example("CMakeLists.txt").find(block), std::string::npos) << block;
    }
}

TEST(Files, EveryCitedSourceIsInTheReferences) {
    EXPECT_EQ(citations("a [Miller 1999] b [Smith 2001, section 3], c[i 2000] [see 1999]"),
              (std::set<std::string>{"Miller 1999", "Smith 2001"}));
    const auto listed = citations(read(project() / "docs/references.md"));
    ASSERT_FALSE(listed.empty());
    for (const auto& file : files_of_the_project({".cpp", ".hpp", ".lua", ".md"})) {
        if (file.filename() == "files_test.cpp") continue; // the made-up sources above
        for (const auto& source : citations(read(file))) {
            EXPECT_TRUE(listed.contains(source)) << file << " cites [" << source << "]";
        }
    }
}

TEST(Files, NothingIsLeftOpen) {
    EXPECT_EQ(lines_with_open_ends("a\n// TO"
                                   "DO: b\n"),
              std::vector<std::size_t>{2});
    EXPECT_TRUE(lines_with_open_ends("the mastodon's tbd\n").empty());
    for (const auto& file : files_of_the_project({".cpp", ".hpp", ".lua", ".md", ".txt", ".sh"})) {
        for (const std::size_t line : lines_with_open_ends(read(file))) ADD_FAILURE() << file << ":" << line;
    }
}

} // namespace
} // namespace tribode::structure
