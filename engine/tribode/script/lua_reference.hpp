#pragma once
#include <string>
#include <vector>

namespace tribode {

// Pages of the documentation have tables that are made from the code, each between two lines:
//
//     <!-- functions: tb.simulate tb.compare -->      usage and result of these functions (LuaFunction)
//     <!-- end -->
//     <!-- options: tb.simulate -->                   the options of this function (LuaFunction::options)
//     <!-- end -->
//     <!-- solvers -->                                the methods of integration (method_list)
//     <!-- end -->
//
// The page with all of its tables made anew. Throws Error where a line names what there is not, or an end is missing.
std::string with_tables(const std::string& page);

// The functions that the page's tables have, in order.
std::vector<std::string> functions_on(const std::string& page);

} // namespace tribode
