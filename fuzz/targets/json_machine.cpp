#include "machine.hpp"
#include "target.hpp"
#include "tribode/base/error.hpp"
#include "tribode/record/json_file.hpp"

namespace tribode::fuzz {

void run_json_machine(std::string_view bytes) {
    try {
        const Json json = parse_json(std::string(bytes), "a.json");
        require(parse_json(to_json_text(json), "again.json") == json, "the same after writing");
        if (json.is_object()) run_machine(json);
    } catch (const InputError&) {
    }
}

} // namespace tribode::fuzz
