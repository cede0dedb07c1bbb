#include "tribode/fmu/fmu_export.hpp"
#include "tribode/base/text.hpp"
#include "tribode/fmu/model_description.hpp"
#include "tribode/fmu/shared_library.hpp"
#include "tribode/record/zip.hpp"
#include "tribode/system/equations_json.hpp"

#include <cctype>
#include <fmt/format.h>

namespace tribode {

namespace {

constexpr const char* licenses =
    R"(The shared library in this archive contains, besides Tribode (MIT):

SUNDIALS (BSD 3-Clause), Copyright (c) 2002-2022, Lawrence Livermore National Security and Southern Methodist University.
KLU and BTF of SuiteSparse (LGPL 2.1 or later), Copyright (c) 2004-2022, University of Florida, T. A. Davis, E. Palamadai.
AMD and COLAMD of SuiteSparse (BSD 3-Clause), Copyright (c) 1996-2022, T. A. Davis, P. R. Amestoy, I. S. Duff, S. Larimore.
{fmt} (MIT), Copyright (c) 2012-present, Victor Zverovich.
JSON for Modern C++ (MIT), Copyright (c) 2013-2022, Niels Lohmann.
Eigen (MPL 2.0), Copyright (c) 2006-2022, its authors.
The GNU C++ library (GPL 3 with the runtime library exception).
The headers of the Functional Mock-up Interface (BSD 2-Clause), Copyright (c) 2008-2023, Modelica Association Project "FMI".

Their sources are packages of Debian; the sources of Tribode say how the library is built of them.
)";

std::string archive(Json model, const FmuOptions& options) {
    model["name"] = options.name;
    model["model_exchange"] = options.model_exchange;
    model["solver"] = options.solver;
    model["version"] = version();
    const std::string hash = sha256(model.dump());
    model["token"] = fmt::format("{{{}-{}-{}-{}-{}}}", hash.substr(0, 8), hash.substr(8, 4), hash.substr(12, 4),
                                 hash.substr(16, 4), hash.substr(20, 12));
    const auto read = fmu::Model::read(model); // may refuse
    read->start(read->settings());             // so may the values at the start
    const bool fmi2 = options.version == FmiVersion::fmi2;
    const std::string binaries = fmi2 ? "binaries/linux64/" : "binaries/x86_64-linux/";
    return zip_archive({{"modelDescription.xml", model_description(*read, options.version)},
                        {"resources/model.json", model.dump()},
                        {binaries + options.name + ".so", std::string(fmu_shared_library())},
                        {"documentation/licenses/license.txt", licenses}});
}

} // namespace

std::string fmu_of_machine(const Json& description, const FmuOptions& options) {
    return archive({{"machine", description}}, options);
}

std::string fmu_of_system(const Equations& equations, const FmuOptions& options) {
    return archive({{"equations", equations_json(equations)}}, options);
}

std::string fmu_name(const std::string& text) {
    std::string name = text;
    for (char& c : name) {
        if (!std::isalnum(static_cast<unsigned char>(c))) c = '_';
    }
    if (name.empty() || std::isdigit(static_cast<unsigned char>(name.front()))) name = "m" + name;
    return name;
}

} // namespace tribode
