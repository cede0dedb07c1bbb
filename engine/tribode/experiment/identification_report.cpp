#include "tribode/analysis/spectral_estimate.hpp"
#include "tribode/base/error.hpp"
#include "tribode/base/text.hpp"
#include "tribode/experiment/identification.hpp"
#include "tribode/record/plot.hpp"

#include <cmath>
#include <cstddef>
#include <fmt/format.h>

namespace tribode {

namespace {

Plot residual_plot(const Identification& found) {
    Plot plot;
    plot.title = "Measured less simulated position";
    Panel time, spectrum;
    time.x_label = "Time [s]";
    time.y_label = "Residual [m]";
    spectrum.x_label = "Frequency [Hz]";
    spectrum.y_label = "Residual [m/sqrt(Hz)]";
    spectrum.x_log = spectrum.y_log = true;
    spectrum.legend = "none";
    SpectrumOptions options;
    options.sample_time = found.machine.sample_time;
    for (std::size_t r = 0; r < found.residuals.size(); ++r) {
        const auto& residual = found.residuals[r];
        Series one{found.residuals.size() > 1 ? fmt::format("record {}", r + 1) : "", {}, residual};
        for (std::size_t k = 0; k < residual.size(); ++k) one.x.push_back(static_cast<double>(k) * options.sample_time);
        time.series.push_back(std::move(one));
        const SpectralEstimate estimate = spectral_estimate({}, residual, options);
        Series lines{"", estimate.frequency_hz, {}};
        for (const double power : estimate.power) lines.y.push_back(std::sqrt(power));
        spectrum.series.push_back(std::move(lines));
    }
    plot.panels = {std::move(time), std::move(spectrum)};
    return plot;
}

} // namespace

std::vector<double> Identification::residual_rms() const {
    std::vector<double> list;
    for (const auto& residual : residuals) {
        double sum = 0;
        for (const double value : residual) sum += value * value;
        list.push_back(std::sqrt(sum / static_cast<double>(residual.size())));
    }
    return list;
}

Json Identification::json() const {
    Json json{{"machine", machine.description()},
              {"parameters", Json::array()},
              {"covariance", covariance},
              {"residual_rms_m", residual_rms()},
              {"excess", excess},
              {"objective", objective},
              {"iterations", iterations},
              {"simulations", simulations},
              {"converged", converged},
              {"notes", notes}};
    for (const auto& one : parameters) {
        json["parameters"].push_back({{"name", one.name},
                                      {"unit", one.unit},
                                      {"start", one.start},
                                      {"value", one.value},
                                      {"standard_error", one.standard_error}});
    }
    return json;
}

std::string Identification::text() const {
    std::string text;
    for (const auto& one : parameters) {
        text += fmt::format("{:30} {:.6g} +- {:.2g} {}\n", one.name, one.value, one.standard_error, one.unit);
    }
    const auto rms = residual_rms();
    for (std::size_t r = 0; r < rms.size(); ++r) {
        text += fmt::format("Record {}: measured less simulated position {:.3g} um rms\n", r + 1, 1e6 * rms[r]);
    }
    text += fmt::format("The standard errors are {:.2g} times those of pure noise{}\n", excess,
                        excess < 2 ? "." : ": the model leaves what is no noise.");
    for (const auto& note : notes) text += note + "\n";
    return text;
}

void write_identification(const Identification& found, RunFolder& folder, const RunControl& control) {
    folder.write_json("machine.json", found.machine.description());
    folder.write_json("identify.json", found.json());
    std::string csv = "name,unit,start,value,standard_error\n";
    for (const auto& one : found.parameters) {
        csv += one.name + ',' + one.unit;
        for (const double value : {one.start, one.value, one.standard_error}) {
            csv += ',';
            append_text(csv, value);
        }
        csv += '\n';
    }
    folder.write("parameters.csv", csv);
    if (control.stop_requested()) throw EndedEarly("an identification was interrupted");
    draw_plot(folder.path("residual"), residual_plot(found));
    folder.add("residual.png");
    folder.add("residual.svg");
}

} // namespace tribode
