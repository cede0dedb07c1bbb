-- The linear-motor-driven table of "A Friction Model-Based Frequency Response Analysis for Frictional Servo
-- Systems", in SI units. Linear dynamics: eq. (1) with Table III, column "Prop. FRA", taken as the truth.
-- Friction: eqs. (11)-(17) with Table II. Where the paper is silent a value is marked *chosen*.
--
-- Optional argument, a table:
--   table_ii  "halved" (default) or "printed": the reading of Table II, see below
--   loop_hz   crossover of the position loop, 7 Hz for sweeps (default), 18 Hz for positioning

local argument = ... or {}
local reading = argument.table_ii or "halved"
local loop_hz = argument.loop_hz or 7
if reading ~= "halved" and reading ~= "printed" then
  error("table_ii = \"" .. tostring(reading) .. "\", must be \"halved\" or \"printed\"", 0)
end

-- Table II prints the full swing of each element. Its F_mi sum to 15.39 N, while Fig. 2 and section II-B put the
-- Coulomb level at 7.7 N, half of it: after a reversal of the velocity an element travels from -F to +F, so the
-- curve measured from a reversal has the swing 2 F over the displacement 2 X. With eq. (14) as printed,
-- abs(f_i) <= F_i, the level is therefore F_mi/2. "printed" takes the numbers as they stand, for comparison.
local share = reading == "halved" and 0.5 or 1.0

-- F_mi [N], K_i [N/mm], D_i [N s/mm]
local table_ii = {
  { 1.12, 2226.6, 0 }, { 0.60, 602.1, 0 }, { 0.33, 165.1, 0 }, { 0.54, 154.9, 0 }, { 0.49, 81.6, 0 },
  { 0.46, 56.8, 0 },   { 0.16, 15.8, 0 },  { 0.36, 30.0, 0 },  { 0.25, 17.9, 0 },  { 0.73, 45.8, 0 },
  { 0.73, 36.2, 0 },   { 0.88, 29.3, 0 },  { 1.34, 26.8, 0 },  { 1.23, 16.4, 0 },  { 0.77, 7.7, 0 },
  { 0.72, 3.6, 0 },    { 0.97, 2.0, 0 },   { 1.08, 1.1, 0 },   { 1.74, 0.9, 0 },   { 0.89, 0.3, 0.01 },
}
local elements = {}
for i, row in ipairs(table_ii) do
  elements[i] = { K = row[2] * 1e3, F = row[1] * share, D = row[3] * 1e3 }
end

local rigid_gain = 94.28e-3
local mass, w = 1 / rigid_gain, 2 * math.pi * loop_hz
local kp = mass * w ^ 2

return {
  Ts = 500e-6,
  rigid_gain_per_kg = rigid_gain,
  -- Table III prints "rad/s" for f1 and f2; Fig. 4 and the text show that the values are in Hz.
  modes = {
    { gain = 13.08e-3, freq_hz = 33.32, zeta = 2.48e-2 },
    { gain = 5.27e-3, freq_hz = 82.22, zeta = 3.22e-3 },
  },
  friction = { coulomb = 0, viscous = 2.35, elements = elements },
  -- The total delay of 1.38 ms is the paper's, its distribution *chosen*: hold 0.25 ms, computation 0.5 ms, current
  -- loop 0.212 ms, encoder and transfer 0.418 ms.
  input_delay_s = 500e-6,
  output_delay_s = 418e-6,
  current_loop_hz = 750,
  encoder_resolution_m = 0.1e-6,
  -- The paper prints no gains; *chosen*.
  controller = { type = "pid", kp = kp, ki = kp * w / 5, kd = 1.4 * mass * w },
  closed_loop = true,
}
