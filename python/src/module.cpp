// The extension module tribode._tribode: the engine's functions for python/tribode/__init__.py, which gives them their
// signatures. Nothing here computes anything.
#include "engine_call.hpp"
#include "lua_system.hpp"
#include "plain_data.hpp"
#include "tribode/analysis/frequency_response.hpp"
#include "tribode/analysis/modal_fit.hpp"
#include "tribode/analysis/spectral_estimate.hpp"
#include "tribode/base/error.hpp"
#include "tribode/base/field_reader.hpp"
#include "tribode/base/field_rows.hpp"
#include "tribode/base/text.hpp"
#include "tribode/diagnosis/diagnosis_files.hpp"
#include "tribode/experiment/frequency_sweep.hpp"
#include "tribode/experiment/identification.hpp"
#include "tribode/experiment/measured_fra.hpp"
#include "tribode/experiment/simulation.hpp"
#include "tribode/experiment/system_run.hpp"
#include "tribode/machine/machine_model.hpp"
#include "tribode/record/output_file.hpp"
#include "tribode/record/record_file.hpp"
#include "tribode/script/batch_script.hpp"
#include "tribode/script/lua_force.hpp"
#include "tribode/script/machine_file.hpp"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <complex>
#include <fmt/format.h>
#include <mutex>
#include <nanobind/stl/complex.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>
#include <numbers>
#include <span>

namespace tribode::python {

namespace {

using nb::literals::operator""_a;
using ComplexSignal = nb::ndarray<const std::complex<double>, nb::ndim<1>, nb::c_contig, nb::device::cpu>;

// A result with its views: what Python holds as `self`.
template <class Type>
using Self = nb::pointer_and_handle<Type>;

Json options_of(nb::handle options, const char* function) {
    Json json = to_json(options, function);
    return json.is_null() ? Json::object() : json;
}

// ---- errors ------------------------------------------------------------------------------------------------------

struct Exceptions {
    PyObject *error, *input_error, *output_error, *ended_early;
} exceptions;

PyObject* add_exception(nb::module_& m, const char* name, const char* doc, std::initializer_list<PyObject*> bases) {
    nb::list list;
    for (PyObject* base : bases) list.append(nb::handle(base));
    const std::string full = std::string("tribode.") + name;
    PyObject* type = PyErr_NewExceptionWithDoc(full.c_str(), doc, nb::tuple(list).ptr(), nullptr);
    if (!type) throw nb::python_error();
    m.attr(name) = nb::handle(type);
    return type;
}

void add_exceptions(nb::module_& m) {
    exceptions.error = add_exception(m, "Error", "What went wrong, in one sentence.", {PyExc_Exception});
    exceptions.input_error =
        add_exception(m, "InputError", "A machine, a record, an option or a file is not as it must be.",
                      {exceptions.error, PyExc_ValueError});
    exceptions.output_error = add_exception(m, "OutputError", "A result could not be written.", {exceptions.error});
    exceptions.ended_early = add_exception(
        m, "EndedEarly", "The run could not go on to its end. Where there is one, `result` holds what was reached.",
        {exceptions.error});
    nb::register_exception_translator([](const std::exception_ptr& problem, void*) {
        try {
            std::rethrow_exception(problem);
        } catch (const EndedEarly& e) {
            PyErr_SetString(exceptions.ended_early, e.what());
        } catch (const InputError& e) {
            PyErr_SetString(exceptions.input_error, e.what());
        } catch (const OutputError& e) {
            PyErr_SetString(exceptions.output_error, e.what());
        } catch (const Error& e) {
            PyErr_SetString(exceptions.error, e.what());
        }
    });
}

// ---- tables ------------------------------------------------------------------------------------------------------

Column& column_of(Table& table, const std::string& name) {
    const auto found = std::find_if(table.columns.begin(), table.columns.end(),
                                    [&](const Column& column) { return column.name == name; });
    if (found != table.columns.end()) return *found;
    throw nb::key_error(fmt::format("there is no column \"{}\"{}", name, suggestion(name, table.names())).c_str());
}

void add_table(nb::module_& m) {
    nb::class_<Table>(m, "Table", "Columns of equal length by name: a mapping from names to arrays.")
        .def("keys", &Table::names)
        .def("__iter__", [](const Table& table) { return nb::iter(nb::cast(table.names())); })
        .def("__len__", [](const Table& table) { return table.columns.size(); })
        .def("__contains__", [](const Table& table, const std::string& name) { return table.find(name) != nullptr; })
        .def("__contains__", [](const Table&, nb::handle) { return false; })
        .def("__getitem__",
             [](Self<Table> self, const std::string& name) { return view(column_of(*self.p, name).values, self.h); })
        .def_prop_ro(
            "units",
            [](const Table& table) {
                nb::dict units;
                for (const auto& column : table.columns) units[nb::cast(column.name)] = column.unit;
                return units;
            },
            "The unit of each column; \"\" where it has none or it is not known.")
        .def("__repr__", [](const Table& table) {
            std::string names;
            for (const auto& name : table.names()) names += (names.empty() ? "" : ", ") + name;
            return fmt::format("<tribode.Table: {} rows of {}>", table.rows(), names);
        });
}

// ---- machines ----------------------------------------------------------------------------------------------------

MachineModel machine_from(nb::handle description) {
    if (nb::isinstance<MachineModel>(description)) return nb::cast<MachineModel>(description);
    if (!is_path(description)) {
        const Json json = to_json(description, "tribode.Machine: the description");
        if (json.is_object()) return MachineModel::from_description(json, "tribode.Machine");
        throw InputError("tribode.Machine: wants a description as a dict, or the path of a .lua or .json file");
    }
    const std::string file = to_path(description);
    EngineCall call(nb::none(), 1);
    return call.run([&](const RunControl& control) {
        return MachineModel::from_description(read_description(file, {}, nullptr, nullptr, control), file);
    });
}

void add_machine(nb::module_& m) {
    nb::class_<MachineModel>(m, "Machine", R"(A servo machine.

Machine(description): the path of a .lua or .json file, or a dict with the same fields (docs/machine-description.md).
The fields that the description has are attributes: machine.Ts, machine.friction["viscous"]. A machine never changes;
with_() makes another one.)")
        .def(
            "__init__",
            [](MachineModel* self, nb::handle description) { new (self) MachineModel(machine_from(description)); },
            "description"_a.none())
        .def(
            "to_dict", [](const MachineModel& machine) { return to_dict(machine.description()); },
            "The description, as plain data of its own.")
        .def(
            "with_",
            [](const MachineModel& machine, nb::handle fields, nb::handle scale, const nb::kwargs& named) {
                const char* const where = "tribode.Machine.with_";
                Json replaced = options_of(fields, where);
                const Json scaled = options_of(scale, where);
                if (!replaced.is_object() || !scaled.is_object()) {
                    throw InputError(fmt::format("{}: wants a dict of fields", where));
                }
                for (const auto [key, value] : named) {
                    const auto path = nb::cast<std::string>(key.attr("replace")("__", "."));
                    replaced[path] = to_json(value, path);
                }
                return machine.with_fields(replaced, scaled, where);
            },
            "fields"_a = nb::none(), nb::kw_only(), "scale"_a = nb::none(), "named"_a,
            R"(The machine with other fields.

machine.with_(noise_rms_m=1e-8, friction__viscous=2.5), where __ stands for a dot, or
machine.with_({"friction.elements[1].K": 2e5, "modes[2].freq_hz": 120}); indices count from 1, [*] is every entry.
scale={"friction.elements[*].F": 1.1} multiplies numbers.)")
        .def_prop_ro(
            "sample_time", [](const MachineModel& machine) { return machine.sample_time; },
            "Sample time of the controller [s]")
        .def_prop_ro("hash", &MachineModel::hash, "SHA-256 of the fields: the same for the same machine.")
        .def(
            "__getattr__",
            [](const MachineModel& machine, const std::string& name) {
                const Json description = machine.description();
                if (description.contains(name)) return to_python(description[name]);
                std::string problem;
                try { // a field that has its default is not written
                    return to_python(machine.field(name));
                } catch (const InputError& error) {
                    problem = error.what();
                }
                throw nb::attribute_error(problem.c_str());
            },
            nb::sig("def __getattr__(self, name: str, /) -> typing.Any"))
        .def("__dir__",
             [](nb::handle self) {
                 nb::list names(nb::module_::import_("builtins").attr("object").attr("__dir__")(self));
                 const Json description = nb::cast<const MachineModel&>(self).description();
                 for (const auto& [key, value] : description.items()) {
                     names.append(nb::cast(key));
                 }
                 return names;
             })
        .def(
            "__eq__", [](const MachineModel& a, const MachineModel& b) { return a.hash() == b.hash(); },
            nb::is_operator())
        .def("__hash__", [](const MachineModel& machine) { return std::hash<std::string>()(machine.hash()); })
        .def("__reduce__",
             [](nb::handle self) { return nb::make_tuple(self.type(), nb::make_tuple(self.attr("to_dict")())); })
        .def("__repr__", [](const MachineModel& machine) {
            return fmt::format("<tribode.Machine: Ts = {} s, {} modes, {} friction elements, {} effects>",
                               to_text(machine.sample_time), machine.modes.size(), machine.elements.size(),
                               machine.effects.size());
        });
}

// ---- runs --------------------------------------------------------------------------------------------------------

Json statistics_of(const RunStatistics& s) {
    Json json;
    for (const auto& [name, count] : RunStatistics::counts) json[name] = s.*count;
    return json;
}

nb::object array_of_rows(const nb::list& rows, std::initializer_list<std::pair<const char*, const char*>> columns) {
    nb::list type;
    for (const auto& [name, kind] : columns) type.append(nb::make_tuple(name, kind));
    return nb::module_::import_("numpy").attr("array")(rows, type);
}

// Columns of results that Python holds no more, for runs of about the same length: to give megabytes back to the system at
// the end of each call, and to get them anew in the next, would take longer than all else that a call does.
class FreedColumns {
  public:
    FreedColumns() { kept_.reserve(most_results); } // to keep some more must not fail

    // Empty where there are none of this length.
    ServoTrace take(std::size_t samples) {
        const std::lock_guard lock(mutex_);
        for (auto kept = kept_.rbegin(); kept != kept_.rend(); ++kept) {
            if (kept->x.capacity() < samples || kept->x.capacity() > 2 * samples) continue;
            ServoTrace columns = std::move(*kept);
            kept_.erase(std::next(kept).base());
            bytes_ -= bytes_of(columns);
            return columns;
        }
        return {};
    }

    void keep(ServoTrace columns) {
        const std::size_t bytes = bytes_of(columns);
        if (bytes == 0 || bytes > most_bytes) return;
        const std::lock_guard lock(mutex_);
        while (bytes_ + bytes > most_bytes || kept_.size() == most_results) {
            bytes_ -= bytes_of(kept_.front());
            kept_.erase(kept_.begin());
        }
        bytes_ += bytes;
        kept_.push_back(std::move(columns));
    }

  private:
    static constexpr std::size_t most_bytes = std::size_t{32} << 20, most_results = 8;

    static std::size_t bytes_of(const ServoTrace& trace) {
        std::size_t count = 0;
        for (const auto column : ServoTrace::columns) count += (trace.*column).capacity();
        return count * sizeof(double);
    }

    std::mutex mutex_; // runs of several threads begin at a time
    std::vector<ServoTrace> kept_;
    std::size_t bytes_ = 0;
};

FreedColumns& freed_columns() {
    static auto* columns = new FreedColumns; // there as long as any result is
    return *columns;
}

struct SimulationResult {
    Simulation simulation;
    double seconds; // in the engine

    SimulationResult(Simulation run, double taken) : simulation(std::move(run)), seconds(taken) {}
    SimulationResult(SimulationResult&&) = default;
    ~SimulationResult() { freed_columns().keep(std::move(simulation.trace)); }
};

// The arguments u, r, exc and y of a simulation, not copied.
DriveView drive_from(const MachineModel& machine, const char* function, const std::optional<Signal>& u,
                     const std::optional<Signal>& r, const std::optional<Signal>& exc, const std::optional<Signal>& y) {
    DriveView drive;
    const char* first = nullptr;
    const auto read = [&](const std::optional<Signal>& signal, const char* name) -> std::span<const double> {
        if (!signal) return {};
        const std::span<const double> values(signal->data(), signal->shape(0));
        if (!first) {
            first = name;
            drive.samples = values.size();
        } else if (values.size() != drive.samples) {
            throw InputError(fmt::format("{}: column {} has {} values, must have {} like column {}", function, name,
                                         values.size(), drive.samples, first));
        }
        return values;
    };
    drive.u = read(u, "u");
    drive.reference = read(r, "r");
    drive.excitation = read(exc, "exc");
    drive.measured = read(y, "y");
    if (DriveRecord::closes_loop(machine, u.has_value(), r || exc, drive.samples, function)) {
        drive.u = {};
    } else {
        drive.reference = drive.excitation = {};
    }
    return drive;
}

template <std::vector<double> ServoTrace::*column>
Array<double> trace_view(Self<SimulationResult> self) {
    return view(self.p->simulation.trace.*column, self.h);
}

SimulationResult run_simulation(const MachineModel& machine, std::optional<Signal> u, std::optional<Signal> r,
                                std::optional<Signal> exc, std::optional<Signal> y, nb::handle options,
                                nb::handle progress) {
    constexpr const char* function = "tribode.simulate";
    const Json json = options_of(options, function);
    FieldReader fields(json, function);
    SimulationOptions run_options;
    read_options(run_options, fields);
    fields.finish();
    const DriveView drive = drive_from(machine, function, u, r, exc, y);
    EngineCall call(progress, 1);
    return call.run([&](const RunControl& control) {
        const auto start = std::chrono::steady_clock::now();
        Simulation result = simulate(machine, drive, run_options, control, freed_columns().take(drive.samples));
        const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
        return SimulationResult{std::move(result), seconds};
    });
}

void add_simulation(nb::module_& m) {
    nb::class_<SimulationResult>(m, "Simulation",
                                 R"(A simulated run: arrays with one entry a sample, that show the numbers
of this object without copies.)")
        .def_prop_ro("t", trace_view<&ServoTrace::t>, "Sample instants [s]")
        .def_prop_ro("r", trace_view<&ServoTrace::r>, "Reference [m]")
        .def_prop_ro("u", trace_view<&ServoTrace::u>, "Thrust reference [N]")
        .def_prop_ro("y", trace_view<&ServoTrace::y>, "Detected position [m]")
        .def_prop_ro("x", trace_view<&ServoTrace::x>, "True position, left limit [m]")
        .def_prop_ro("v", trace_view<&ServoTrace::v>, "True velocity, left limit [m/s]")
        .def_prop_ro("f", trace_view<&ServoTrace::f>, "Friction force, left limit [N]")
        .def_prop_ro(
            "events",
            [](const SimulationResult& self) {
                nb::list rows;
                for (const auto& event : self.simulation.events) {
                    rows.append(nb::make_tuple(event.t, event.subject,
                                               std::string(name_of(static_cast<SlipState>(event.kind)))));
                }
                return array_of_rows(rows, {{"t", "f8"}, {"element", "i4"}, {"kind", "U13"}});
            },
            nb::for_getter(nb::sig("def events(self, /) -> numpy.typing.NDArray[typing.Any]")),
            "Stick-slip transitions in time order: an array with the fields t [s], element (0: dry friction) and kind "
            "(slip_forward, slip_backward, stick)")
        .def_prop_ro(
            "ok", [](const SimulationResult& self) { return self.simulation.outcome.ok(); },
            "Whether the run reached its end")
        .def_prop_ro(
            "message", [](const SimulationResult& self) { return self.simulation.outcome.message; },
            "Why the run ended early; empty otherwise")
        .def_prop_ro(
            "solver", [](const SimulationResult& self) { return name_of(self.simulation.method); },
            "The solver that was used")
        .def_prop_ro(
            "statistics",
            [](const SimulationResult& self) { return to_dict(statistics_of(self.simulation.statistics)); },
            "Counts of steps, evaluations and events")
        .def_prop_ro(
            "seconds", [](const SimulationResult& self) { return self.seconds; }, "Wall time in the engine [s]")
        .def("__repr__", [](const SimulationResult& self) {
            return fmt::format("<tribode.Simulation: {} samples, {} events, solver {}>", self.simulation.trace.t.size(),
                               self.simulation.events.size(), name_of(self.simulation.method));
        });
    m.def("simulate", run_simulation, "machine"_a, "u"_a.none(), "r"_a.none(), "exc"_a.none(), "y"_a.none(),
          "options"_a, "progress"_a.none());
}

// ---- frequency responses -----------------------------------------------------------------------------------------

FrequencyResponse response_from(const Signal& frequency_hz, const ComplexSignal& value) {
    constexpr const char* where = "tribode.FrequencyResponse";
    FrequencyResponse response;
    response.frequency_hz = finite_numbers(frequency_hz, where, "frequency_hz");
    response.value.assign(value.data(), value.data() + value.shape(0));
    const auto& f = response.frequency_hz;
    if (f.size() != response.value.size()) {
        throw InputError(fmt::format("{}: there are {} frequencies and {} values, must be as many of each", where,
                                     f.size(), response.value.size()));
    }
    for (std::size_t i = 0; i < f.size(); ++i) {
        if (f[i] > (i ? f[i - 1] : 0)) continue;
        throw InputError(
            fmt::format("{}: frequency_hz[{}] = {}, must be positive and ascend", where, i, to_text(f[i])));
    }
    return response;
}

FrequencyResponse response_at(const ModalModel& model, const Signal& frequency_hz, const char* function) {
    FrequencyResponse response;
    response.frequency_hz = finite_numbers(frequency_hz, function, "frequency_hz");
    for (std::size_t i = 0; i < response.size(); ++i) {
        const double f = response.frequency_hz[i];
        if (!(f > (i ? response.frequency_hz[i - 1] : 0))) {
            throw InputError(
                fmt::format("{}: frequency_hz[{}] = {}, must be positive and ascend", function, i, to_text(f)));
        }
        response.value.push_back(model.response(f));
    }
    return response;
}

void require_points(const FrequencyResponse& response) {
    if (response.size() == 0) throw InputError("the frequency response is empty, must have a frequency");
}

void add_frequency_response(nb::module_& m) {
    nb::class_<FrequencyResponse>(m, "FrequencyResponse", R"(One complex value a frequency.

FrequencyResponse(frequency_hz, value): arrays of equal length; frequencies ascend.)")
        .def(
            "__init__",
            [](FrequencyResponse* self, const Signal& frequency_hz, const ComplexSignal& value) {
                new (self) FrequencyResponse(response_from(frequency_hz, value));
            },
            "frequency_hz"_a, "value"_a)
        .def_prop_ro(
            "frequency_hz", [](Self<FrequencyResponse> self) { return view(self.p->frequency_hz, self.h); },
            "Frequencies [Hz]")
        .def_prop_ro(
            "value", [](Self<FrequencyResponse> self) { return view(self.p->value, self.h); },
            "Complex values, output per input: m/N for a plant")
        .def_prop_ro(
            "gain_db", [](const FrequencyResponse& self) { return to_array(self.gain_db()); }, nb::rv_policy::automatic,
            "Gain [dB]")
        .def_prop_ro(
            "phase_deg",
            [](const FrequencyResponse& self) {
                return to_array(self.size() ? self.phase_deg() : std::vector<double>{});
            },
            nb::rv_policy::automatic, "Phase without jumps [deg]")
        .def(
            "at",
            [](const FrequencyResponse& self, double frequency_hz) {
                require_points(self);
                return self.at(frequency_hz);
            },
            "frequency_hz"_a, "The value at a frequency between the points, interpolated")
        .def(
            "remove_delay",
            [](const FrequencyResponse& self, double delay_s) {
                if (!std::isfinite(delay_s)) throw InputError("remove_delay: delay_s must be finite");
                return self.remove_delay(delay_s);
            },
            "delay_s"_a, "The response without a dead time")
        .def("__len__", &FrequencyResponse::size)
        .def("__reduce__",
             [](nb::handle self) {
                 return nb::make_tuple(self.type(), nb::make_tuple(self.attr("frequency_hz"), self.attr("value")));
             })
        .def("__repr__", [](const FrequencyResponse& self) {
            if (self.size() == 0) return std::string("<tribode.FrequencyResponse: empty>");
            return fmt::format("<tribode.FrequencyResponse: {} frequencies from {} to {} Hz>", self.size(),
                               to_text(self.frequency_hz.front()), to_text(self.frequency_hz.back()));
        });
}

void add_sweep(nb::module_& m) {
    nb::class_<SweepResult>(m, "Sweep", "A sine sweep of a machine in closed loop.")
        .def_prop_ro(
            "responses",
            [](const SweepResult& self) {
                nb::dict responses;
                for (auto& [name, response] : self.responses()) responses[nb::cast(name)] = std::move(response);
                return responses;
            },
            "The FrequencyResponse of each analysis by its name: FRA-1 (thrust to position), FRA-2 (with friction "
            "compensation), Proposed (friction model-based)")
        .def_prop_ro(
            "loop_gain", [](const SweepResult& self) { return self.loop_gain(); },
            "Loop gain of the closed loop, opened at u")
        .def_prop_ro(
            "table", [](const SweepResult& self) { return self.table(); },
            "One row a frequency, with coherence, distortion and settling time")
        .def_prop_ro(
            "warnings", [](const SweepResult& self) { return self.warnings(); },
            "Frequencies that failed or did not settle")
        .def_prop_ro(
            "statistics", [](const SweepResult& self) { return to_dict(statistics_of(self.statistics())); },
            "Counts of steps, evaluations and events")
        .def("__repr__", [](const SweepResult& self) {
            return fmt::format("<tribode.Sweep: {} frequencies>", self.points.size());
        });
    m.def(
        "sweep",
        [](const MachineModel& machine, nb::handle options_given, unsigned workers, const std::string& checkpoint,
           nb::handle progress) {
            const Json json = options_of(options_given, "tribode.sweep");
            FieldReader fields(json, "tribode.sweep");
            SweepOptions options;
            read_options(options, fields);
            fields.finish();
            EngineCall call(progress, workers);
            SweepResult result =
                call.run([&](const RunControl& control) { return run_sweep(machine, options, control, checkpoint); });
            if (!result.complete) {
                throw EndedEarly(fmt::format("interrupted after {} of {} frequencies", result.points.size(),
                                             options.frequency_hz.size()));
            }
            return result;
        },
        "machine"_a, "options"_a, "workers"_a, "checkpoint"_a, "progress"_a.none());
    m.def(
        "fit_modal",
        [](const FrequencyResponse& response, nb::handle options_given) {
            const Json json = options_of(options_given, "tribode.fit_modal");
            FieldReader fields(json, "tribode.fit_modal");
            ModalFitOptions options;
            read_options(options, fields);
            fields.finish();
            EngineCall call(nb::none(), 1);
            return to_dict(
                call.run([&](const RunControl&) { return tribode::to_json(fit_modal_model(response, options)); }));
        },
        "response"_a, "options"_a);
    m.def(
        "plant_response",
        [](const MachineModel& machine, const Signal& frequency_hz) {
            return response_at(modal_model_of(machine), frequency_hz, "tribode.plant_response");
        },
        "machine"_a, "frequency_hz"_a);
    m.def(
        "plant_parameters",
        [](const MachineModel& machine) { return to_dict(tribode::to_json(modal_model_of(machine))); }, "machine"_a);
    m.def(
        "model_response",
        [](nb::handle model, const Signal& frequency_hz) {
            constexpr const char* function = "tribode.model_response";
            return response_at(modal_model_from_json(to_json(model, function), function), frequency_hz, function);
        },
        "model"_a.none(), "frequency_hz"_a);
}

// ---- records, diagnosis, batches ---------------------------------------------------------------------------------

RecordOptions record_options(nb::handle columns, nb::handle scale, const char* function) {
    const Json json{{"columns", to_json(columns, "columns")}, {"scale", to_json(scale, "scale")}};
    FieldReader fields(json, function);
    RecordOptions options = RecordOptions::read(fields);
    fields.finish();
    return options;
}

Table read_record_file(nb::handle path, nb::handle columns, nb::handle scale) {
    const std::string file = to_path(path);
    const RecordOptions options = record_options(columns, scale, "tribode.read_record");
    EngineCall call(nb::none(), 1);
    return call.run([&](const RunControl&) { return read_record(file, options).table; });
}

GivenRecord given_record(nb::handle data, const std::string& where) {
    if (is_path(data)) return {to_path(data), {}};
    return {{}, to_table(data, where)};
}

Measurement measurement_of(const GivenRecord& record, const MachineModel& machine, const RecordOptions& options,
                           std::vector<std::string>& hashes) {
    hashes.push_back(record.hash());
    if (!record.file.empty()) return read_measurement(record.file, machine, options);
    return measurement_from_table(record.table, machine, record.table.source);
}

struct Diagnosed {
    Diagnosis diagnosis;
    Json summary;
};

nb::list compared_of(std::vector<Compared>& records) {
    nb::list list;
    for (auto& record : records) {
        nb::dict columns;
        columns["first"] = record.first;
        columns["t"] = to_array(record.measurement.drive.t);
        columns["u_measured"] = to_array(record.measurement.thrust);
        columns["y_measured"] = to_array(record.measurement.position());
        columns["u_before"] = to_array(record.u_before);
        columns["y_before"] = to_array(record.y_before);
        columns["u_after"] = to_array(record.u_after);
        columns["y_after"] = to_array(record.y_after);
        list.append(columns);
    }
    return list;
}

nb::dict run_diagnosis(const MachineModel& machine, const nb::list& data, nb::handle validate, nb::handle columns,
                       nb::handle scale, nb::handle options_given, const std::string& folder, unsigned workers,
                       nb::handle progress) {
    constexpr const char* function = "tribode.diagnose";
    const auto start = std::chrono::steady_clock::now();
    const RecordOptions names = record_options(columns, scale, function);
    const Json json = options_of(options_given, function);
    FieldReader fields(json, function);
    DiagnosisOptions options;
    read_options(options, fields);
    fields.finish();
    std::vector<GivenRecord> given;
    for (const nb::handle record : data) {
        given.push_back(given_record(record, fmt::format("data[{}]", given.size())));
    }
    if (given.empty()) throw InputError(fmt::format("{}: data is empty, must have a measured record", function));
    std::optional<GivenRecord> validation;
    if (!validate.is_none()) validation = given_record(validate, "validate");

    EngineCall call(progress, workers);
    Diagnosed result = call.run([&](const RunControl& control) {
        std::vector<std::string> hashes;
        std::vector<Measurement> records;
        for (const auto& record : given) records.push_back(measurement_of(record, machine, names, hashes));
        std::optional<Measurement> not_fitted;
        if (validation) not_fitted = measurement_of(*validation, machine, names, hashes);
        Diagnosis diagnosis = diagnose(machine, std::move(records), std::move(not_fitted), options, control);
        const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
        Json summary = diagnosis_json(diagnosis, hashes, machine.hash(), seconds);
        if (!folder.empty()) {
            RunFolder files(folder);
            write_diagnosis(diagnosis, summary, files, control);
        }
        return Diagnosed{std::move(diagnosis), std::move(summary)};
    });
    nb::dict summary = to_dict(result.summary);
    summary[nb::str("machine")] = nb::cast(result.diagnosis.after);
    summary[nb::str("records")] = compared_of(result.diagnosis.fitted);
    summary[nb::str("validation")] = compared_of(result.diagnosis.validation);
    return summary;
}

// Each analysis as arrays with an entry a frequency.
nb::dict analysis_of(const MeasuredAnalysis& analysis) {
    nb::dict columns;
    const auto add = [&](const char* name, auto value_of) {
        std::vector<double> values;
        for (const auto& point : analysis.points) values.push_back(value_of(point));
        columns[name] = to_array(std::move(values));
    };
    columns["response"] = response_of(analysis.points);
    add("frequency_hz", [](const MeasuredPoint& p) { return p.frequency_hz; });
    std::vector<std::complex<double>> values;
    for (const auto& point : analysis.points) values.push_back(point.value);
    columns["value"] = to_array(std::move(values));
    add("std_gain_db", [](const MeasuredPoint& p) { return p.standard_gain_db(); });
    add("std_phase_deg", [](const MeasuredPoint& p) { return p.standard_phase_deg(); });
    add("coherence", [](const MeasuredPoint& p) { return p.coherence; });
    add("odd_distortion", [](const MeasuredPoint& p) { return p.odd_distortion; });
    add("even_distortion", [](const MeasuredPoint& p) { return p.even_distortion; });
    add("settled", [](const MeasuredPoint& p) { return p.settled ? 1.0 : 0.0; });
    return columns;
}

nb::dict run_identify(const MachineModel& machine, const nb::list& data, nb::handle columns, nb::handle scale,
                      nb::handle options_given, const std::string& folder, unsigned workers, nb::handle progress) {
    constexpr const char* function = "tribode.identify";
    const RecordOptions names = record_options(columns, scale, function);
    const Json json = options_of(options_given, function);
    FieldReader fields(json, function);
    IdentifyOptions options;
    read_options(options, fields);
    fields.finish();
    std::vector<GivenRecord> records;
    for (const nb::handle record : data) {
        records.push_back(given_record(record, fmt::format("data[{}]", records.size())));
    }
    if (records.empty()) throw InputError(fmt::format("{}: data is empty, must have a measured record", function));
    EngineCall call(progress, workers);
    Identification found = call.run([&](const RunControl& control) {
        Identification result = identify(machine, records, names, options, control);
        if (!folder.empty()) {
            RunFolder files(folder);
            write_identification(result, files, control);
        }
        return result;
    });
    nb::dict result = to_dict(found.json());
    result["machine"] = nb::cast(found.machine);
    nb::list residuals;
    for (auto& residual : found.residuals) residuals.append(to_array(std::move(residual)));
    result["residuals"] = residuals;
    return result;
}

// ---- any signals -------------------------------------------------------------------------------------------------

nb::dict run_frf(const Signal& input, const Signal& output, const std::optional<Signal>& excitation,
                 nb::handle options_given) {
    constexpr const char* function = "tribode.frf";
    const Json json = options_of(options_given, function);
    FieldReader fields(json, function);
    const double sample_time = fields.number("sample_time_s", "s", Allowed::positive);
    const long window = fields.integer("window_samples", 0, 1L << 24, 0);
    fields.finish();
    const auto x = finite_numbers(input, function, "input"), y = finite_numbers(output, function, "output");
    const auto reference = excitation ? finite_numbers(*excitation, function, "excitation") : x;
    if (x.size() != y.size() || x.size() != reference.size()) {
        throw InputError(fmt::format("{}: {} samples of input, {} of output, {} of excitation, must be as many of each",
                                     function, x.size(), y.size(), reference.size()));
    }
    EngineCall call(nb::none(), 1);
    MeasuredAnalysis analysis;
    analysis.points = call.run([&](const RunControl&) {
        return cross_spectra({{sample_time, reference, y, {x}, 0}}, static_cast<std::size_t>(window)).front();
    });
    return analysis_of(analysis);
}

nb::dict run_spectrum(const Signal& output, const nb::list& inputs, nb::handle options_given) {
    constexpr const char* function = "tribode.spectrum";
    const Json json = options_of(options_given, function);
    FieldReader fields(json, function);
    SpectrumOptions options;
    read_options(options, fields);
    fields.finish();
    const auto y = finite_numbers(output, function, "output");
    std::vector<std::vector<double>> x;
    for (const nb::handle input : inputs) {
        x.push_back(finite_numbers(nb::cast<Signal>(input), function, fmt::format("inputs[{}]", x.size()).c_str()));
    }
    EngineCall call(nb::none(), 1);
    SpectralEstimate found = call.run([&](const RunControl&) { return spectral_estimate(x, y, options); });
    nb::dict result;
    const std::vector<double> frequency_hz = found.frequency_hz;
    result["frequency_hz"] = to_array(std::move(found.frequency_hz));
    result["power"] = to_array(std::move(found.power));
    result["windows"] = found.windows;
    result["averages"] = found.averages;
    result["bandwidth_hz"] = found.bandwidth;
    result["power_low"] = found.power_low;
    result["power_high"] = found.power_high;
    nb::list by_input;
    for (auto& input : found.inputs) {
        nb::dict one;
        one["power"] = to_array(std::move(input.power));
        one["cross_power"] = to_array(std::move(input.cross));
        one["coherence"] = to_array(std::move(input.coherence));
        one["h1"] = FrequencyResponse{frequency_hz, std::move(input.h1)};
        if (!input.h2.empty()) {
            one["h2"] = FrequencyResponse{frequency_hz, std::move(input.h2)};
            one["hv"] = FrequencyResponse{frequency_hz, std::move(input.hv)};
        }
        std::vector<double> gain = input.standard_deviation, phase = input.standard_deviation;
        for (double& error : gain) error *= 20 / std::numbers::ln10;
        for (double& error : phase) error *= 180 / std::numbers::pi;
        one["std_gain_db"] = to_array(std::move(gain));
        one["std_phase_deg"] = to_array(std::move(phase));
        by_input.append(one);
    }
    result["inputs"] = by_input;
    if (x.empty()) return result;
    result["coherence"] = to_array(std::move(found.coherence));
    result["coherence_threshold"] = found.coherence_threshold;
    result["noise_power"] = to_array(std::move(found.noise));
    return result;
}

nb::dict run_fra(const MachineModel& machine, const nb::list& data, nb::handle columns, nb::handle scale,
                 nb::handle options_given, const std::string& folder, nb::handle progress) {
    constexpr const char* function = "tribode.fra";
    FraRequest request;
    request.machine = machine;
    request.columns = record_options(columns, scale, function);
    const Json json = options_of(options_given, function);
    FieldReader fields(json, function);
    read_options(request.options, fields);
    fields.finish();
    for (const nb::handle record : data) {
        request.records.push_back(given_record(record, fmt::format("data[{}]", request.records.size())));
    }
    if (request.records.empty()) {
        throw InputError(fmt::format("{}: data is empty, must have a measured record", function));
    }
    EngineCall call(progress, 1);
    const MeasuredFra fra = call.run([&](const RunControl& control) {
        MeasuredFra result = measure_fra(request);
        if (!folder.empty()) {
            RunFolder files(folder);
            write_measured_fra(result, files, control);
        }
        return result;
    });
    nb::dict result, analyses;
    for (const auto& analysis : fra.analyses)
        analyses[nb::cast(title_of_method(analysis.method))] = analysis_of(analysis);
    result["analyses"] = analyses;
    result["fits"] = to_python(fra.fits());
    result["records"] = fra.records;
    result["notes"] = fra.notes;
    result["delay_s"] = fra.delay;
    return result;
}

void add_files(nb::module_& m) {
    m.def("fra", run_fra, "machine"_a, "data"_a, "columns"_a.none(), "scale"_a.none(), "options"_a, "folder"_a,
          "progress"_a.none());
    m.def("identify", run_identify, "machine"_a, "data"_a, "columns"_a.none(), "scale"_a.none(), "options"_a,
          "folder"_a, "workers"_a, "progress"_a.none());
    m.def("frf", run_frf, "input"_a, "output"_a, "excitation"_a.none(), "options"_a);
    m.def("spectrum", run_spectrum, "output"_a, "inputs"_a, "options"_a);
    m.def("read_record", read_record_file, "path"_a, "columns"_a.none(), "scale"_a.none());
    m.def("diagnose", run_diagnosis, "machine"_a, "data"_a, "validate"_a.none(), "columns"_a.none(), "scale"_a.none(),
          "options"_a, "folder"_a, "workers"_a, "progress"_a.none());
    m.def(
        "read_batch",
        [](nb::handle path) {
            const std::string folder = to_path(path);
            EngineCall call(nb::none(), 1);
            return to_dict(call.run([&](const RunControl&) { return merged_batch(folder); }), Lists::arrays);
        },
        "path"_a);
}

// ---- systems of equations ----------------------------------------------------------------------------------------

void add_systems(nb::module_& m) {
    nb::class_<LuaSystem>(m, "LuaSystem")
        .def(
            "__init__",
            [](LuaSystem* self, nb::handle text, nb::handle file, const std::vector<std::string>& read, bool compile) {
                auto* system = new (self)
                    LuaSystem{.text = {}, .name = "system", .folder = {}, .read_folders = {}, .compile = compile};
                system->read_folders.assign(read.begin(), read.end());
                if (file.is_none()) {
                    system->text = nb::cast<std::string>(text);
                } else {
                    system->name = to_path(file);
                    system->text = read_file(system->name);
                    const auto folder = std::filesystem::path(system->name).parent_path();
                    system->folder = folder.empty() ? "." : folder;
                }
            },
            "text"_a.none(), "file"_a.none(), "read"_a, "compile"_a)
        .def_ro("name", &LuaSystem::name)
        .def(
            "run",
            [](const LuaSystem& system, nb::handle options, nb::handle progress) {
                const Json json = options_of(options, "the options");
                EngineCall call(progress, 1);
                LuaSystemRun result = call.run([&](const RunControl& control) { return run(system, json, control); });
                nb::object info = to_python(result.info);
                nb::list rows;
                for (const auto& event : result.info["events"]) {
                    rows.append(nb::make_tuple(event["t"].get<double>(), event["name"].get<std::string>()));
                }
                std::size_t width = 1;
                for (const auto& event : result.info["events"])
                    width = std::max(width, event["name"].get<std::string>().size());
                info[nb::str("events")] =
                    array_of_rows(rows, {{"t", "f8"}, {"name", fmt::format("U{}", width).c_str()}});
                return nb::make_tuple(nb::cast(std::move(result.table)), info);
            },
            "options"_a, "progress"_a.none())
        .def(
            "call",
            [](const LuaSystem& system, const std::string& function, nb::handle options, bool arrays) {
                const Json json = options_of(options, "the options");
                EngineCall engine(nb::none(), 1);
                const Json result =
                    engine.run([&](const RunControl& control) { return call(system, function, json, control); });
                return to_dict(result, arrays ? Lists::arrays : Lists::lists);
            },
            "function"_a, "options"_a, "arrays"_a);
}

// ---- the options of each function --------------------------------------------------------------------------------

template <class Options>
nb::list rows_of() {
    nb::list list;
    for (const auto& row : field_rows<Options>()) {
        nb::dict entry;
        entry["path"] = row.path;
        entry["unit"] = row.unit;
        entry["values"] = row.values;
        entry["default"] = row.fallback;
        entry["meaning"] = std::string(row.about.meaning);
        list.append(entry);
    }
    return list;
}

void add_options(nb::module_& m) {
    m.def("options", [] {
        nb::dict options;
        options["simulate"] = rows_of<SimulationOptions>();
        options["sweep"] = rows_of<SweepOptions>();
        options["fit_modal"] = rows_of<ModalFitOptions>();
        options["fra"] = rows_of<MeasuredFraOptions>();
        options["identify"] = rows_of<IdentifyOptions>();
        options["spectrum"] = rows_of<SpectrumOptions>();
        options["diagnose"] = rows_of<DiagnosisOptions>();
        options["run"] = rows_of<SystemRunOptions>();
        return options;
    });
}

} // namespace

} // namespace tribode::python

NB_MODULE(_tribode, m) {
    using namespace tribode::python;
    m.doc() = "The engine of Tribode; import tribode instead.";
    m.attr("__version__") = tribode::version();
    tribode::enable_lua_forces();
    add_exceptions(m);
    add_table(m);
    add_machine(m);
    add_simulation(m);
    add_frequency_response(m);
    add_sweep(m);
    add_files(m);
    add_systems(m);
    add_options(m);
}
