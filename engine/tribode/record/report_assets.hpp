#pragma once
#include <string_view>

namespace tribode {

// What each report carries, as the build read it from third_party/uplot and record/assets.
extern const std::string_view uplot_js, uplot_css, uplot_licence; // third_party/uplot
extern const std::string_view report_js, report_css;              // record/assets

} // namespace tribode
