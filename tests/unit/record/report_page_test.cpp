#include "tribode/record/report.hpp"
#include "unit/record/browser.hpp"

#include <cmath>
#include <gtest/gtest.h>

namespace tribode {
namespace {

Report report_with(const std::string& name) {
    Report report{.title = name, .summary = name};
    Plot bode{.title = name};
    bode.panels.push_back({.y_label = "g", .x_log = true, .y_log = true});
    bode.panels.push_back({.title = name, .x_label = name, .y_label = name, .x_log = true});
    Plot loop{.title = "loop", .panels = {{.x_label = "x", .y_label = "F"}}};
    Series gain{.name = name}, circle{.name = "circle", .style = SeriesStyle::dashed};
    for (int i = 0; i <= 400; ++i) {
        gain.x.push_back(10 + i * 0.475);
        gain.y.push_back(1 + i);
        circle.x.push_back(std::cos(i * M_PI / 200));
        circle.y.push_back(std::sin(i * M_PI / 200));
    }
    bode.panels[0].series = {gain};
    bode.panels[1].series = {gain};
    bode.panels[1].series[0].style = SeriesStyle::line_points;
    loop.panels[0].series = {circle};
    report.sections.push_back({name,
                               {Paragraph{name}, BulletList{{name}}, Preformatted{name},
                                ReportTable{name, {{name, name}, {"n"}}, {{name, 1.0}}},
                                Figure{.caption = name, .plot = bode}, Figure{.plot = loop}}});
    return report;
}

TEST(ReportPage, DrawsItsPlotsAndZooms) {
    if (!has_browser()) GTEST_SKIP() << browser << " is not installed";
    const TemporaryFolder folder;
    write_report(folder / "r.html", report_with("Gain [µm]"));
    const auto result = visit(folder, read_file(folder / "r.html"), R"js(
        const canvases = [...document.querySelectorAll('canvas')];
        const coloured = (c) => {
            const p = c.getContext('2d').getImageData(0, 0, c.width, c.height).data;
            let n = 0;
            for (let i = 0; i < p.length; i += 4) if (p[i + 3] > 200 && p[i] < 60 && p[i + 1] > 90 && p[i + 2] > 150) n++;
            return n;
        };
        seen.coloured = canvases.map(coloured);
        seen.images = [...document.querySelectorAll('figure > img')].map((i) => [i.naturalWidth, i.offsetWidth]);
        seen.sideways = document.documentElement.scrollWidth - document.documentElement.clientWidth;
        // A drag over the middle of the first panel moves the axis of the second, too.
        const over = document.querySelectorAll('.u-over');
        const box = over[0].getBoundingClientRect();
        const fire = (target, type, x, y) => target.dispatchEvent(new MouseEvent(type,
            { bubbles: true, clientX: box.left + x * box.width, clientY: box.top + y * box.height, button: 0, view: window,
              movementX: 1 }));
        const keys = () => [...document.querySelectorAll('.keys')].map((k) => k.textContent);
        fire(over[0], 'mouseenter', 0.5, 0.5);
        fire(over[0], 'mousemove', 0.5, 0.5);
        seen.keys = keys();
        fire(over[0], 'mousedown', 0.25, 0.5);
        fire(over[0], 'mousemove', 0.75, 0.5);
        fire(document, 'mouseup', 0.75, 0.5);
        const shown = () => !document.querySelector('.hint button').hidden;
        seen.zoomed = shown();
        document.querySelector('.live > div[tabindex]').dispatchEvent(new KeyboardEvent('keydown', { key: '0' }));
        seen.reset = !shown();
    )js");
    expect_quiet(result);
    // Curves of palette blue: hundreds of pixels each.
    ASSERT_EQ(result.seen.at("coloured").size(), 3u);
    for (const auto& n : result.seen.at("coloured")) EXPECT_GT(n.get<int>(), 300);
    for (const auto& image : result.seen.at("images")) {
        EXPECT_EQ(image[0], 1400) << "the image is whole";
        EXPECT_EQ(image[1], 0) << "and hidden behind the interactive plot";
    }
    EXPECT_EQ(result.seen.at("sideways"), 0);
    // Half-way of a logarithmic axis from 10 to 200 is 44.7; the nearest sample is number 73, of value 74.
    // Half way; the width of the page, and with it the point under the pointer, differs by a pixel now and then.
    EXPECT_EQ(result.seen.at("keys")[0], result.seen.at("keys")[1]);
    EXPECT_TRUE(result.seen.at("keys")[0].get<std::string>().starts_with("Gain [µm]: 44."));
    EXPECT_EQ(result.seen.at("keys")[2], "circle");
    EXPECT_TRUE(result.seen.at("zoomed"));
    EXPECT_TRUE(result.seen.at("reset"));
}

TEST(ReportPage, NamesOfStrangersDoNotRun) {
    if (!has_browser()) GTEST_SKIP() << browser << " is not installed";
    // The last one opens what it never closes, so it has a page of its own.
    const std::string all = "</script><script>window.owned = 1</script><img src=x onerror=\"window.owned=1\">"
                            "\" onload=\"window.owned=1\" x=\" <svg/onload=window.owned=1> </textarea></title>"
                            "<link rel=stylesheet href=http://192.0.2.1/x.css><iframe src=http://192.0.2.1/></iframe>";
    for (const std::string& name : {all, std::string("<!--<script>")}) {
        const TemporaryFolder folder;
        write_report(folder / "r.html", report_with(name));
        const auto result = visit(folder, read_file(folder / "r.html"), R"js(
            seen.owned = window.owned === 1;
            seen.title = document.title;
            seen.canvases = document.querySelectorAll('canvas').length;
            seen.strangers = document.querySelectorAll('iframe, svg, object, link[rel=stylesheet]').length;
            seen.scripts = document.scripts.length;
        )js");
        expect_quiet(result);
        EXPECT_FALSE(result.seen.at("owned")) << name;
        EXPECT_EQ(result.seen.at("title"), name);
        EXPECT_EQ(result.seen.at("canvases"), 3) << name;
        EXPECT_EQ(result.seen.at("strangers"), 0) << name;
        EXPECT_EQ(result.seen.at("scripts"), 5) << "two of data, the page's own, two of this test";
    }
}

// What would get through the escaping: the policy stops it.
TEST(ReportPage, ThePolicyStopsAScriptThatIsNotThePagesOwn) {
    if (!has_browser()) GTEST_SKIP() << browser << " is not installed";
    const TemporaryFolder folder;
    write_report(folder / "r.html", report_with("x"));
    std::string page = read_file(folder / "r.html");
    page.insert(page.find("<main>"), "<script>window.owned = 1</script><img src=\"http://192.0.2.1/x.png\">");
    const auto result = visit(folder, page, "seen.owned = window.owned === 1;");
    EXPECT_FALSE(result.seen.at("owned"));
    EXPECT_EQ(result.seen.at("violations").size(), 2u);
    EXPECT_EQ(result.net.find("\"url\":\"http://192.0.2.1"), std::string::npos);
}

} // namespace
} // namespace tribode
