#include "tribode/solver/prepared_steps.hpp"

namespace tribode {

std::shared_ptr<const PreparedSteps::Matrices> PreparedSteps::known_matrices(const AffineKey& key) const {
    const std::lock_guard lock(mutex_);
    const auto known = patterns_.find(key);
    return known == patterns_.end() ? nullptr : known->second.matrices;
}

std::shared_ptr<const PreparedSteps::Propagation> PreparedSteps::known_propagation(const AffineKey& key,
                                                                                   double h) const {
    const std::lock_guard lock(mutex_);
    const auto known = patterns_.find(key);
    if (known == patterns_.end()) return nullptr;
    for (const auto& [length, propagation] : known->second.propagations) {
        if (length == h) return propagation;
    }
    return nullptr;
}

std::shared_ptr<const PreparedSteps::Matrices> PreparedSteps::keep(const AffineKey& key,
                                                                   std::shared_ptr<const Matrices> made) {
    const std::lock_guard lock(mutex_);
    if (patterns_.size() < max_patterns) patterns_.try_emplace(key, Pattern{made, {}});
    return made;
}

std::shared_ptr<const PreparedSteps::Propagation> PreparedSteps::keep(const AffineKey& key, double h,
                                                                      std::shared_ptr<const Propagation> made) {
    const std::lock_guard lock(mutex_);
    const auto known = patterns_.find(key);
    if (known != patterns_.end() && known->second.propagations.size() < max_lengths) {
        known->second.propagations.emplace_back(h, made);
    }
    return made;
}

} // namespace tribode
