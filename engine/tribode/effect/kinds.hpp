#pragma once
#include "tribode/effect/effect.hpp"

// The kinds of effects, each in the file of its name.
namespace tribode::effects {

extern const EffectKind coulomb_friction;
extern const EffectKind viscous_friction;
extern const EffectKind stribeck_friction;
extern const EffectKind presliding_hysteresis;
extern const EffectKind asymmetric_friction;
extern const EffectKind position_dependent_friction;
extern const EffectKind time_varying_friction;
extern const EffectKind force_ripple;
extern const EffectKind constant_force;
extern const EffectKind spring_force;
extern const EffectKind cubic_stiffness;
extern const EffectKind quadratic_drag;
extern const EffectKind periodic_disturbance;
extern const EffectKind backlash;
extern const EffectKind dead_zone;
extern const EffectKind thrust_saturation;
extern const EffectKind thrust_gain;
extern const EffectKind payload_mass;
extern const EffectKind input_delay;
extern const EffectKind actuator_lag;
extern const EffectKind resonant_mode;
extern const EffectKind encoder_quantization;
extern const EffectKind encoder_periodic_error;
extern const EffectKind own_force;

} // namespace tribode::effects
