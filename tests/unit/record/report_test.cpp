#include "tribode/base/text.hpp"
#include "tribode/record/output_file.hpp"
#include "tribode/record/report.hpp"
#include "unit/script/messages.hpp"
#include "unit/script/temporary_folder.hpp"

#include <cmath>
#include <gtest/gtest.h>
#include <regex>

namespace tribode {
namespace {

Report small_report() {
    Plot plot{.title = "Gain", .width = 400, .height = 300};
    plot.panels.push_back({.x_label = "f [Hz]", .y_label = "g [dB]", .x_log = true});
    plot.panels[0].series.push_back({.name = "measured", .x = {1, 10, 100}, .y = {0, std::nan(""), 3}});
    Report report{.title = "A report", .summary = "All is well."};
    report.sections.push_back(
        {"First",
         {Paragraph{"Some words."}, BulletList{{"one", "two"}}, Preformatted{"a  b\nc"},
          ReportTable{
              "Numbers", {{"name"}, {"gain", "dB", 2}, {"free"}}, {{"first", 1.0, 123456.0}, {"second", -12.345, NAN}}},
          Figure{.caption = "Below.", .plot = plot}}});
    return report;
}

std::size_t count(const std::string& text, const std::string& part) {
    std::size_t n = 0;
    for (std::size_t at = 0; (at = text.find(part, at)) != std::string::npos; at += part.size()) ++n;
    return n;
}

// The data of the first interactive plot.
Json data_of(const std::string& page) {
    const std::string begin = "<script type=\"application/json\">";
    const std::size_t from = page.find(begin) + begin.size();
    return Json::parse(page.substr(from, page.find("</script>", from) - from));
}

TEST(Report, HoldsAllItsPartsInOnePage) {
    const TemporaryFolder folder;
    EXPECT_EQ(write_report(folder / "r.html", small_report()), std::vector<std::string>{"r_1.png"});
    const std::string page = read_file(folder / "r.html");
    for (const char* part :
         {"<title>A report</title>", "<h1>A report</h1>", "<p class=\"summary\">All is well.</p>", "First</h2>",
          "<p>Some words.</p>", "<li>two</li>", "a  b\nc</pre>", "<caption>Numbers</caption>",
          "<th scope=\"col\" class=\"n\">gain<span class=\"unit\">[dB]</span></th>", "<td class=\"n\">-12.35</td>",
          "<td class=\"n\">1.235e+05</td>", "<td class=\"n\">–</td>", "Below. <a href=\"./r_1.png\">",
          "alt=\"Plot: Gain. g [dB] against f [Hz]: measured.\"", "src=\"data:image/png;base64,iVBORw0KGgo",
          "Permission is hereby granted"}) {
        EXPECT_NE(page.find(part), std::string::npos) << part;
    }
    EXPECT_TRUE(read_file(folder / "r_1.png").starts_with("\x89PNG"));
    // A break in the curve stays one.
    EXPECT_EQ(data_of(page).at("panels")[0].at("series")[0].at("y"), Json::parse("[0.0, null, 3.0]"));
}

TEST(Report, TheSameReportGivesTheSameBytes) {
    const TemporaryFolder folder;
    write_report(folder / "r.html", small_report());
    const std::string first = read_file(folder / "r.html");
    RunControl two;
    two.workers = 2;
    write_report(folder / "r.html", small_report(), two);
    EXPECT_EQ(read_file(folder / "r.html"), first);
}

// Nothing in the page names another place, apart from text within comments of the licence.
TEST(Report, NamesNoOtherPlace) {
    const TemporaryFolder folder;
    write_report(folder / "r.html", small_report());
    const std::string page = read_file(folder / "r.html");
    EXPECT_NE(page.find("content=\"default-src 'none'; img-src data:; style-src 'sha256-"), std::string::npos);
    EXPECT_EQ(page.find("unsafe"), std::string::npos);
    for (const char* way : {"src=\"http", "href=\"http", "href=\"/", "url(", "@import", "fetch(", "XMLHttpRequest"}) {
        EXPECT_EQ(page.find(way), std::string::npos) << way;
    }
}

TEST(Report, TextsStayTexts) {
    const TemporaryFolder folder;
    const std::string hostile = "</script><script>alert(1)</script><img src=x onerror=alert(1)>\"'& \x01\xff";
    Report report = small_report();
    report.title = report.summary = report.sections[0].title = hostile;
    auto& blocks = report.sections[0].blocks;
    std::get<Paragraph>(blocks[0]).text = hostile;
    std::get<BulletList>(blocks[1]).items[0] = hostile;
    std::get<Preformatted>(blocks[2]).text = hostile;
    auto& table = std::get<ReportTable>(blocks[3]);
    table.caption = table.columns[0].name = table.columns[1].unit = hostile;
    table.rows[0][0] = hostile;
    auto& figure = std::get<Figure>(blocks[4]);
    figure.caption = hostile;
    figure.file = "javascript:x\"><script>";
    figure.plot.title = "a</script><script>alert(1)"; // gnuplot gets it, too
    figure.plot.panels[0].title = figure.plot.panels[0].y_label = "<b>";
    figure.plot.panels[0].series[0].name = "</script><script>alert(1)</script>";
    write_report(folder / "r.html", report);
    const std::string page = read_file(folder / "r.html");
    EXPECT_EQ(count(page, "<script"), 2u) << "the data and the page's own script";
    EXPECT_EQ(count(page, "<img"), 1u);
    EXPECT_EQ(count(page, "<b>"), 0u);
    EXPECT_EQ(page.find('\x01'), std::string::npos);
    EXPECT_EQ(page.find('\xff'), std::string::npos);
    EXPECT_NE(page.find("href=\"./javascript%3Ax%22%3E%3Cscript%3E.png\""), std::string::npos);
    EXPECT_EQ(data_of(page).at("panels")[0].at("series")[0].at("name"), "</script><script>alert(1)</script>");
}

TEST(Report, ThinsLongCurvesAndKeepsTheirPeaks) {
    const TemporaryFolder folder;
    Report report = small_report();
    auto& figure = std::get<Figure>(report.sections[0].blocks[4]);
    Series curve{.name = "long"}, loop{.name = "loop"};
    constexpr int n = 30'000;
    for (int i = 0; i < n; ++i) {
        const double t = i * 1e-3;
        curve.x.push_back(1 + t);
        curve.y.push_back(i == 4321 ? 7 : (i == 24321 ? -5 : std::sin(t)));
        loop.x.push_back(50 + 40 * std::cos(t));
        loop.y.push_back(std::sin(t));
    }
    figure.plot.panels[0].x_log = false;
    figure.plot.panels[0].series = {curve, loop};
    write_report(folder / "r.html", report);
    const Json data = data_of(read_file(folder / "r.html"));
    const auto shown = data.at("panels")[0].at("series")[0].at("y").get<std::vector<double>>();
    EXPECT_LE(shown.size(), 8000u);
    EXPECT_EQ(*std::max_element(shown.begin(), shown.end()), 7);
    EXPECT_EQ(*std::min_element(shown.begin(), shown.end()), -5);
    // The loop goes round 5 times; each point is at most 1/2000 of the panel away from one that is shown.
    const auto& loop_data = data.at("panels")[0].at("series")[1];
    const auto lx = data.at("x")[loop_data.at("x").get<std::size_t>()].get<std::vector<double>>();
    const auto ly = loop_data.at("y").get<std::vector<double>>();
    EXPECT_LT(lx.size(), loop.x.size());
    const auto xr = data.at("panels")[0].at("xr").get<Range>(), yr = data.at("panels")[0].at("yr").get<Range>();
    for (int i = 0; i < n; i += 997) {
        double least = INFINITY;
        for (std::size_t k = 0; k < lx.size(); ++k) {
            least = std::min(least,
                             std::hypot((lx[k] - loop.x[i]) / (xr[1] - xr[0]), (ly[k] - loop.y[i]) / (yr[1] - yr[0])));
        }
        EXPECT_LT(least, 1.0 / 2000) << i;
    }
    EXPECT_TRUE(data.at("note").get<std::string>().starts_with("Thinned: of 60000 points the "));
}

TEST(Report, PanelsWithTheSameAxisAreLinked) {
    const TemporaryFolder folder;
    Report report = small_report();
    auto& panels = std::get<Figure>(report.sections[0].blocks[4]).plot.panels;
    panels.push_back(panels[0]);
    panels[0].x_label = "";
    panels.push_back(panels[1]);
    panels[2].x_range = Range{5, 50};
    write_report(folder / "r.html", report);
    const Json data = data_of(read_file(folder / "r.html"));
    EXPECT_EQ(data.at("panels")[0].at("group"), data.at("panels")[1].at("group"));
    EXPECT_NE(data.at("panels")[0].at("group"), data.at("panels")[2].at("group"));
    EXPECT_EQ(data.at("panels")[0].at("xname"), "f [Hz]") << "an axis without a name has that of the panel below";
}

TEST(Report, RefusesWhatDoesNotFit) {
    const TemporaryFolder folder;
    Report report = small_report();
    std::get<ReportTable>(report.sections[0].blocks[3]).rows[1].pop_back();
    EXPECT_EQ(problem_of([&] { write_report(folder / "r.html", report); }),
              "input: report, section \"First\", table \"Numbers\": row 2 has 2 cells, must have 3 like the columns");
    EXPECT_FALSE(std::filesystem::exists(folder / "r.html"));
    for (const char* file : {"../x", "/tmp/x", "."}) {
        report = small_report();
        std::get<Figure>(report.sections[0].blocks[4]).file = file;
        EXPECT_NE(problem_of([&] { write_report(folder / "r.html", report); }).find("must lie beside the page"),
                  std::string::npos)
            << file;
    }
    const auto refused = [&](const char* json) {
        return problem_of([&] { report_from_json(Json::parse(json), "tb.report", folder.path()); });
    };
    EXPECT_EQ(refused(R"({"titel": "x"})"), "input: tb.report: title is missing (a text)");
    EXPECT_NE(refused(R"({"title": "x", "sections": [{"title": "y", "content": [{"tabel": {}}]}]})").find("content[1]"),
              std::string::npos);
    EXPECT_NE(refused(R"({"title": "x", "sections": [{"title": "y", "content": [{"plot": "../../etc/x"}]}]})")
                  .find("must lie beside the page"),
              std::string::npos);
    EXPECT_EQ(refused(R"({"title": "x", "sections": [{"title": "y", "content": ["a", {"list": ["b"]},
                          {"preformatted": "c"}, {"table": {"columns": [{"name": "n", "unit": "m", "decimals": 2}],
                          "rows": [[1.5], ["never"]]}}, {"plot": {"panels": []}, "caption": "d"}]}]})"),
              "none: ");
}

} // namespace
} // namespace tribode
