#include "tribode/diagnosis/given_files.hpp"
#include "tribode/base/error.hpp"

#include <fmt/format.h>
#include <map>

namespace tribode {

void refuse_repeated_files(const std::vector<std::filesystem::path>& files, const std::vector<std::string>& hashes) {
    std::map<std::string, std::filesystem::path> known;
    for (std::size_t i = 0; i < files.size(); ++i) {
        const auto [first, is_new] = known.emplace(hashes[i], files[i]);
        if (is_new) continue;
        throw InputError(fmt::format("{}: has the same content as {}, must be another record", files[i].string(),
                                     first->second == files[i] ? "one before it" : first->second.string()));
    }
}

} // namespace tribode
