#pragma once
#include "tribode/diagnosis/system_fit.hpp"
#include "tribode/record/record_file.hpp"

#include <filesystem>
#include <map>
#include <string>
#include <vector>

namespace tribode {

// How the columns of records belong to a system. Both maps: name in the system -> column; what is not named has a column of
// its own name, or none.
struct SystemColumns {
    std::map<std::string, std::string> inputs, outputs;
    RecordOptions record; // the column t and factors to SI; other columns count as inputs and outputs
};

// The model of a system for a diagnosis: what the records measure, and which values may be fitted. `free`: names of parameters
// and "STATE.start"; empty: those that the system names, else all of them. Measured are the outputs and states that
// `columns` names, else those with a column of their name in the first record.
// Throws InputError on unknown names, with the nearest, and where nothing is measured.
SystemModel system_model_of(Equations equations, const std::vector<std::string>& free, const SystemColumns& columns,
                            const std::vector<std::filesystem::path>& records);

// Throws InputError as read_record does, and where a record is too short.
SystemRecord read_system_record(const std::filesystem::path& file, const SystemModel& model,
                                const SystemColumns& columns);

// The equations without outputs that were made to measure a state, where these are still nothing else.
Equations without_measured_states(const SystemModel& model);

// A measured output as the user calls it: one that was made for a state has the name of the state.
std::string measured_name(const SystemModel& model, std::size_t output);

// The rate of change of a recorded motion: central differences over a few samples.
std::vector<double> rate_of(const std::vector<double>& x, const std::vector<double>& t);

} // namespace tribode
