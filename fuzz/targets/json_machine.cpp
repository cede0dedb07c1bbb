#include "base/error.hpp"
#include "machine.hpp"
#include "record/json_file.hpp"
#include "target.hpp"

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
