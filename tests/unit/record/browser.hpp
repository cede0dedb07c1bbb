#pragma once
#include "tribode/base/text.hpp"
#include "tribode/record/output_file.hpp"
#include "unit/script/temporary_folder.hpp"

#include <cstdlib>
#include <gtest/gtest.h>
#include <regex>
#include <string>

// What a page does in a browser. Tests are skipped where the Debian package chromium-headless-shell is not installed.
namespace tribode {

inline constexpr const char* browser = "chromium-headless-shell";

inline bool has_browser() { return std::system("command -v chromium-headless-shell >/dev/null 2>&1") == 0; }

inline std::string base64(const std::string& hex) {
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
inline Visit visit(const TemporaryFolder& folder, const std::string& page, const std::string& probe) {
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

inline void expect_quiet(const Visit& visit) {
    EXPECT_EQ(visit.seen.at("violations"), Json::array());
    EXPECT_EQ(visit.seen.at("errors"), Json::array());
    EXPECT_EQ(visit.log.find("CONSOLE"), std::string::npos) << visit.log;
    // The page itself is a file and its images lie in it; anything else would be a request to somewhere.
    static const std::regex url(R"re("url":"([a-z-]+):)re");
    for (std::sregex_iterator it(visit.net.begin(), visit.net.end(), url), last; it != last; ++it) {
        EXPECT_TRUE((*it)[1] == "file" || (*it)[1] == "data") << it->str();
    }
}

} // namespace tribode
