#include "tribode/analysis/modal_fit.hpp"
#include "tribode/design/feedforward.hpp"
#include "tribode/design/trajectory.hpp"
#include "tribode/script/conversions.hpp"
#include "tribode/script/lua_function.hpp"

namespace tribode {

namespace {

Json feedforward(const Json& arguments) {
    FieldReader fields(arguments, "tb.feedforward");
    const ModalModel model = modal_model_from_json(fields.value("model"), "tb.feedforward");
    FeedforwardOptions options;
    read_options(options, fields);
    FrequencyResponse response{fields.numbers("frequency_hz", "Hz", Allowed::positive, {}), {}};
    fields.finish();
    const Feedforward designed = design_feedforward(model, options);
    for (const double f : response.frequency_hz) response.value.push_back(designed.thrust_response(f));
    Json json = to_json(designed);
    json["response"] = to_json(response);
    return json;
}

Json trajectory(const Json& arguments) {
    FieldReader fields(arguments, "tb.trajectory");
    TrajectoryOptions options;
    read_options(options, fields);
    fields.finish();
    const Trajectory made = make_trajectory(options);
    return {{"values", made.position},
            {"velocity", made.velocity},
            {"acceleration", made.acceleration},
            {"arrival_s", made.arrival}};
}

} // namespace

const std::vector<LuaFunction>& design_functions() {
    static const std::vector<LuaFunction> functions = {
        {"feedforward", feedforward, "`tb.feedforward{ model =, … }`",
         "designs a feedforward on a modal model, a table as `tb.fit_modal` gives it ([options and "
         "result](#tbfeedforward))",
         [] {
             auto rows = option_rows<FeedforwardOptions>(
                 {{"model", "", "table", "required", "a modal model, as `tb.fit_modal` returns it"}});
             rows.push_back({"frequency_hz", "Hz", "list of numbers, each > 0", "none", "of `response`"});
             return rows;
         }},
        {"trajectory", trajectory, "`tb.trajectory{ points_m = {…}, max_velocity =, … }`",
         "moves from limits, trapezoids or S-curves of third order, as a reference: `values` [m], `velocity`, "
         "`acceleration` at the samples, and `arrival_s` of each move ([options](#tbtrajectory))",
         [] { return option_rows<TrajectoryOptions>({}); }},
    };
    return functions;
}

} // namespace tribode
