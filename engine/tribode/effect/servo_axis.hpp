#pragma once
#include "tribode/control/amplifier.hpp"
#include "tribode/control/periodic_encoder_error.hpp"
#include "tribode/plant/servo_plant.hpp"

#include <vector>

namespace tribode {

// What a servo machine is made of besides its controller and clocks: the part that effects change.
struct ServoAxis {
    ServoPlant::Parameters plant;
    Amplifier amplifier;
    double input_delay = 0; // sample instant to actuator, besides the hold [s]
    double encoder_resolution = 0;
    std::vector<PeriodicEncoderError> encoder_errors;

    // Throws InputError where the machine and its effects together leave something that cannot be: gains that are next to
    // nothing or all too large, friction or a delay below zero, backlash in a machine without a rigid body.
    void require_possible() const;
};

} // namespace tribode
