#pragma once
#include <string>

namespace tribode {

// Of the sources that this was built from, "30683c6a5f01", followed by "-dirty" where they were changed since; empty where they
// are no git repository.
std::string commit();

} // namespace tribode
