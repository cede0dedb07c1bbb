#include "tribode/base/text.hpp"
#include "tribode/base/error.hpp"

#include <algorithm>
#include <charconv>
#include <fmt/format.h>
#include <limits>
#include <memory>
#include <numeric>
#include <openssl/evp.h>
#include <utility>

namespace tribode {

void append_text(std::string& buffer, double value) {
    char digits[32];
    const auto end = std::to_chars(digits, digits + sizeof digits, value).ptr;
    buffer.append(digits, end);
}

std::string to_text(double value) {
    std::string text;
    append_text(text, value);
    return text;
}

std::string_view trim(std::string_view text) {
    constexpr std::string_view blanks = " \t\r\n";
    const auto first = text.find_first_not_of(blanks);
    if (first == std::string_view::npos) return {};
    return text.substr(first, text.find_last_not_of(blanks) - first + 1);
}

std::string printable(std::string_view text, std::string_view kept) {
    std::string result;
    for (std::size_t i = 0; i < text.size(); ++i) {
        const auto c = static_cast<unsigned char>(text[i]);
        // In UTF-8, U+0080 to U+009F are control characters, too.
        const bool high = c == 0xc2 && i + 1 < text.size() && (static_cast<unsigned char>(text[i + 1]) & 0xe0) == 0x80;
        const bool control = c < 0x20 || c == 0x7f || high;
        if (control && kept.find(text[i]) == std::string_view::npos) {
            result += fmt::format("\\x{:02x}", c);
            if (high) result += fmt::format("\\x{:02x}", static_cast<unsigned char>(text[++i]));
        } else {
            result += text[i];
        }
    }
    return result;
}

std::optional<double> parse_number(std::string_view text) {
    text = trim(text);
    if (text.starts_with('+') && !text.starts_with("+-")) text.remove_prefix(1);
    double value = 0;
    const auto [end, problem] = std::from_chars(text.data(), text.data() + text.size(), value);
    if (text.empty() || problem != std::errc{} || end != text.data() + text.size()) return std::nullopt;
    return value;
}

// Levenshtein distance, one row at a time.
static std::size_t edit_distance(std::string_view a, std::string_view b) {
    std::vector<std::size_t> row(b.size() + 1);
    std::iota(row.begin(), row.end(), std::size_t{0});
    for (std::size_t i = 1; i <= a.size(); ++i) {
        std::size_t diagonal = std::exchange(row[0], i);
        for (std::size_t j = 1; j <= b.size(); ++j) {
            const std::size_t substitute = diagonal + (a[i - 1] != b[j - 1]);
            diagonal = row[j];
            row[j] = std::min({row[j] + 1, row[j - 1] + 1, substitute});
        }
    }
    return row.back();
}

std::string nearest_name(std::string_view name, const std::vector<std::string>& candidates) {
    std::string best;
    std::size_t least = std::numeric_limits<std::size_t>::max();
    for (const auto& candidate : candidates) {
        const std::size_t distance = edit_distance(name, candidate);
        const bool begun = !name.empty() && candidate.starts_with(name);
        if ((begun || distance <= name.size() / 2) && distance < least) {
            least = distance;
            best = candidate;
        }
    }
    return best;
}

std::string suggestion(std::string_view name, const std::vector<std::string>& candidates) {
    if (const auto best = nearest_name(name, candidates); !best.empty()) {
        return fmt::format(" (did you mean \"{}\"?)", best);
    }
    return fmt::format(" (known: {})", fmt::join(candidates, ", "));
}

static EVP_MD_CTX* context_of(void* context) { return static_cast<EVP_MD_CTX*>(context); }

static void require_sha256(int status) {
    if (status != 1) throw Error("SHA-256 is not available from the system's OpenSSL");
}

Sha256::Sha256() : context_(EVP_MD_CTX_new()) {
    require_sha256(EVP_DigestInit_ex(context_of(context_), EVP_sha256(), nullptr));
}

Sha256::~Sha256() { EVP_MD_CTX_free(context_of(context_)); }

void Sha256::add(std::string_view bytes) {
    require_sha256(EVP_DigestUpdate(context_of(context_), bytes.data(), bytes.size()));
}

std::string Sha256::hex() const {
    const std::unique_ptr<EVP_MD_CTX, decltype(&EVP_MD_CTX_free)> copy(EVP_MD_CTX_new(), EVP_MD_CTX_free);
    unsigned char digest[EVP_MAX_MD_SIZE];
    unsigned length = 0;
    require_sha256(EVP_MD_CTX_copy_ex(copy.get(), context_of(context_)));
    require_sha256(EVP_DigestFinal_ex(copy.get(), digest, &length));
    return fmt::format("{:02x}", fmt::join(digest, digest + length, ""));
}

std::string sha256(std::string_view bytes) {
    Sha256 hash;
    hash.add(bytes);
    return hash.hex();
}

std::string version() { return TRIBODE_VERSION; }

} // namespace tribode
