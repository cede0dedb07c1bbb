#pragma once
#include "tribode/experiment/simulation.hpp"
#include "tribode/machine/machine_model.hpp"
#include "tribode/record/record_file.hpp"
#include "tribode/record/table.hpp"

#include <filesystem>
#include <string>
#include <vector>

namespace tribode {

// A measured record of a machine, checked and ready to be simulated.
struct Measurement {
    std::string source;         // the file
    DriveRecord drive;          // t, then r and the recovered excitation (closed loop) or u; y as `measured`
    std::vector<double> thrust; // u[k] as recorded: controller and excitation [N]

    std::size_t size() const { return drive.t.size(); }
    const std::vector<double>& position() const { return drive.measured; }
    void cut(std::size_t samples); // to its first samples
};

// Reads t, u, y and, in closed loop, r. The excitation is what the recorded u has besides the output of the machine's
// controller on the recorded r and y; below the rounding of the file it is zero.
//
// What cannot be diagnosed is refused with one sentence (InputError): a missing column, another sample time or a gap,
// values that are not finite, a record that is too short or has no motion, y in another unit than r, u and y in each
// other's place, samples of y that were dropped or held, an outlier, rows that are missing, u or y that were clipped, a
// controller that does not fit the data.
Measurement measurement_from_table(const Table& table, const MachineModel& machine, const std::string& where);

// The same from a file (read_record).
Measurement read_measurement(const std::filesystem::path& file, const MachineModel& machine,
                             const RecordOptions& options = {});

// The controller's output on recorded r and y, sample by sample [N]; the machine must have a controller.
std::vector<double> controller_output(const MachineModel& machine, const std::vector<double>& reference,
                                      const std::vector<double>& position);

// The greatest common step of the values, where six different ones and more lie on a lattice: the resolution the encoder
// really had [m]; 0 where there is none above `least`.
double lattice_step(const std::vector<double>& values, double least);

} // namespace tribode
