#include "tribode/solver/prepared_steps.hpp"

#include <algorithm>
#include <bit>

namespace tribode {

namespace {

// To the bit: zeros of different signs may lead to different results.
bool are_same(const std::vector<double>& a, const std::vector<double>& b) {
    return std::equal(a.begin(), a.end(), b.begin(), b.end(), [](double x, double y) {
        return std::bit_cast<std::uint64_t>(x) == std::bit_cast<std::uint64_t>(y);
    });
}

} // namespace

std::shared_ptr<const PreparedSteps::Propagation> PreparedSteps::Pattern::known_propagation(double h) const {
    const std::lock_guard lock(mutex_);
    for (const auto& [length, propagation] : propagations_) {
        if (length == h) return propagation;
    }
    return nullptr;
}

std::shared_ptr<const PreparedSteps::Propagation>
PreparedSteps::Pattern::keep(double h, std::shared_ptr<const Propagation> made) {
    const std::lock_guard lock(mutex_);
    if (propagations_.size() < max_lengths) propagations_.emplace_back(h, made);
    return made;
}

std::shared_ptr<PreparedSteps::Pattern> PreparedSteps::known_pattern(const AffineKey& key,
                                                                     const AffineForm& form) const {
    const std::lock_guard lock(mutex_);
    const auto known = patterns_.find(key);
    if (known == patterns_.end()) return nullptr;
    for (const auto& [of, pattern] : known->second) {
        if (are_same(of.a, form.a) && are_same(of.g, form.g)) return pattern;
    }
    return nullptr;
}

std::shared_ptr<PreparedSteps::Pattern> PreparedSteps::keep(const AffineKey& key, const AffineForm& form,
                                                            std::shared_ptr<Pattern> made) {
    const std::lock_guard lock(mutex_);
    if (count_ == max_patterns) return made;
    auto& known = patterns_[key];
    if (known.size() == max_forms) return made;
    known.push_back({form, made});
    ++count_;
    return made;
}

} // namespace tribode
