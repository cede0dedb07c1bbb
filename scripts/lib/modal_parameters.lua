-- The parameters of a fitted modal model by short names: k0, k1, f1, zeta1, k2, ... A script says:
-- local modal_parameters = require "lib.modal_parameters".
--
--   modal_parameters(fit)   fit: { k0, modes = { { gain, freq_hz, zeta }, ... } }, of tb.fra, or its standard errors

return function(fit)
  local values = { k0 = fit.k0 }
  for j, mode in ipairs(fit.modes) do
    values["k" .. j], values["f" .. j], values["zeta" .. j] = mode.gain, mode.freq_hz, mode.zeta
  end
  return values
end
