-- A batch: how two frequencies of a sweep move with friction and delay.
local tb = require "tribode"
local machine = tb.machine "models/linear_motor_table.lua"

tb.batch {
    name = "friction and delay", seed = 1, count = tb.quick and 4 or 200,
    points = function(index) return { friction = 0.5 + index / 200, delay_s = 1e-5 * (index % 20) } end,
    units = { delay_s = "s" },
    run = function(point, seed)
        machine.friction.viscous = 2.35 * point.friction
        machine.input_delay_s = point.delay_s
        local sweep = tb.sweep { machine = machine, frequency_hz = { 15, 25 }, amplitude_N = 15, seed = seed }
        local response = sweep.responses["FRA-1"]
        return { gain_db = response.gain_db }
    end,
    finish = function(batch)
        for i, gain_db in ipairs(batch.results.gain_db) do
            print(batch.parameters.friction[i], batch.parameters.delay_s[i], gain_db[1], gain_db[2])
        end
    end,
}
