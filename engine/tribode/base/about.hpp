#pragma once
#include <cmath>
#include <string_view>

namespace tribode {

// A further name of a choice, which is accepted and never written.
struct Alias {
    std::string_view name, means;
};

// What a describe() says of a field besides its name, unit and allowed values: what it means, which values are usual, and
// how a fit may move it. A text alone is the meaning. The texts must outlive all that is described: literals do.
//
//     fields.number("zeta", mode.zeta, "", Allowed::non_negative, About("damping ratio").usually(0, 1).uncertain("modes.zeta"));
struct About {
    std::string_view meaning;
    // Outside of this range a value is allowed but implausible: of its magnitude, unless the range begins below zero. Zero
    // is always plausible; min == max: nothing is known.
    double min = 0, max = 0;
    std::string_view hint;      // ends the warning: what may have been mistaken
    std::string_view tolerance; // key of the machine's tolerance; empty: the field is exact
    Alias alias;                // of a choice; empty: none

    constexpr About() = default;
    constexpr About(std::string_view text) : meaning(text) {}
    constexpr About(const char* text) : meaning(text) {}

    constexpr About usually(double least, double most, std::string_view mistaken = {}) const {
        About about = *this;
        about.min = least;
        about.max = most;
        about.hint = mistaken;
        return about;
    }
    // Fields with the same key are moved by one factor, unless the key is the field's own path without indices.
    constexpr About uncertain(std::string_view key) const {
        About about = *this;
        about.tolerance = key;
        return about;
    }
    constexpr About also(Alias another) const {
        About about = *this;
        about.alias = another;
        return about;
    }

    bool plausible(double value) const {
        if (min == max || value == 0) return true;
        const double x = min < 0 ? value : std::abs(value);
        return x >= min && x <= max;
    }
    constexpr operator std::string_view() const { return meaning; }
};

} // namespace tribode
