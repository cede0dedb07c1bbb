#include "experiment/friction_model.hpp"

namespace tribode {

std::optional<FrictionModel> FrictionModel::read(FieldReader& fields) {
    if (fields.value("friction_model").is_null()) return std::nullopt;
    FrictionModel model;
    FieldReader table = fields.table("friction_model");
    table.each("elements", [&](FieldReader& element) {
        model.elements.push_back({element.number("K", "N/m", Allowed::positive),
                                  element.number("F", "N", Allowed::positive),
                                  element.number("D", "N s/m", Allowed::non_negative, 0)});
    });
    model.viscous = table.number("viscous", "N s/m", Allowed::non_negative, 0);
    table.finish();
    return model;
}

} // namespace tribode
