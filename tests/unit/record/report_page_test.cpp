#include "base/text.hpp"
#include "record/output_file.hpp"
#include "record/report.hpp"
#include "unit/script/temporary_folder.hpp"

#include <cmath>
#include <cstdlib>
#include <gtest/gtest.h>
#include <regex>

// What a page does in a browser. Without the Debian package chromium-headless-shell these tests are skipped.
namespace tribode {
namespace {

constexpr const char* browser = "chromium-headless-shell";

bool has_browser() { return std::system("command -v chromium-headless-shell >/dev/null 2>&1") == 0; }

std::string base64(const std::string& hex) {
    std::string bytes, digits = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/", text;
    for (std::size_t i = 0; i < hex.size(); i += 2) {
        bytes += static_cast<char>(std::stoi(hex.substr(i, 2), nullptr, 16));
    }
    bytes += '\0'; // 32 bytes are one short of eleven groups
    for (std::size_t i = 0; i < bytes.size(); i += 3) {
        unsigned three = 0;
        for (std::size_t k = 0; k < 3; ++k) three = three << 8 | static_cast<unsigned char>(bytes[i + k]);
        for (int shift = 18; shift >= 0; shift -= 6) text += digits[three >> shift & 63];
    }
    text.back() = '=';
    return text;
}

struct Visit {
    Json seen;       // what the watching script found
    std::string log; // of the browser
    std::string net; // every request it began
};

// Opens a page in a browser of its own, with two scripts of the test that the page's policy is made to allow: one that
// watches from the beginning, and `probe`, which runs at the end and fills `seen`.
Visit visit(const TemporaryFolder& folder, const std::string& page, const std::string& probe) {
    const std::string watch = "window.seen = { violations: [], errors: [] };"
                              "document.addEventListener('securitypolicyviolation', (e) =>"
                              " seen.violations.push(e.violatedDirective + ' ' + e.blockedURI));"
                              "window.addEventListener('error', (e) => seen.errors.push(String(e.message)));";
    // By then the images are there and the canvases painted.
    const std::string end = "window.addEventListener('load', () => setTimeout(() => { try {" + probe +
                            "} catch (e) { seen.errors.push(String(e)); }"
                            "const out = document.createElement('pre'); out.id = 'seen';"
                            "out.textContent = btoa(unescape(encodeURIComponent(JSON.stringify(seen))));"
                            "document.body.append(out); }, 200));";
    std::string changed = page;
    const auto put = [&](const std::string& before, const std::string& text) {
        const auto at = changed.rfind(before);
        ASSERT_NE(at, std::string::npos) << before;
        changed.insert(at, text);
    };
    put("<meta name=\"viewport\"", "<script>" + watch + "</script>");
    put("</body>", "<script>" + end + "</script>");
    const std::string policy = "script-src ";
    changed.insert(changed.find(policy) + policy.size(),
                   "'sha256-" + base64(sha256(watch)) + "' 'sha256-" + base64(sha256(end)) + "' ");
    write_file(folder / "page.html", changed);
    const std::string at = folder.path().string();
    const std::string command =
        std::string(browser) +
        " --headless --no-sandbox --disable-gpu --disable-quic --no-first-run --disable-background-networking"
        " --disable-component-update --disable-sync --proxy-server=127.0.0.1:9 --window-size=1000,1400"
        " --user-data-dir='" +
        at + "/user' --log-net-log='" + at +
        "/net.json' --enable-logging=stderr --virtual-time-budget=5000 --dump-dom 'file://" + at + "/page.html' >'" +
        at + "/dom.html' 2>'" + at + "/log.txt'";
    EXPECT_EQ(std::system(command.c_str()), 0);
    Visit result;
    result.log = read_file(folder / "log.txt");
    result.net = read_file(folder / "net.json");
    const std::string dom = read_file(folder / "dom.html");
    std::smatch match;
    static const std::regex found(R"(<pre id="seen">([A-Za-z0-9+/=]*)</pre>)");
    if (!std::regex_search(dom, match, found)) {
        ADD_FAILURE() << "the probe did not run: " << result.log;
        return result;
    }
    // Back from base64: atob of the browser, by hand.
    std::string bytes;
    unsigned bits = 0;
    int held = 0;
    const std::string digits = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    for (const char c : match[1].str()) {
        if (c == '=') break;
        bits = bits << 6 | static_cast<unsigned>(digits.find(c));
        if ((held += 6) >= 8) bytes += static_cast<char>(bits >> (held -= 8) & 255);
    }
    result.seen = Json::parse(bytes);
    return result;
}

void expect_quiet(const Visit& visit) {
    EXPECT_EQ(visit.seen.at("violations"), Json::array());
    EXPECT_EQ(visit.seen.at("errors"), Json::array());
    EXPECT_EQ(visit.log.find("CONSOLE"), std::string::npos) << visit.log;
    // The page itself is a file and its images lie in it; anything else would be a request to somewhere.
    static const std::regex url(R"re("url":"([a-z-]+):)re");
    for (std::sregex_iterator it(visit.net.begin(), visit.net.end(), url), last; it != last; ++it) {
        EXPECT_TRUE((*it)[1] == "file" || (*it)[1] == "data") << it->str();
    }
}

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
