#include "tribode/solver/method_list.hpp"

#include <gtest/gtest.h>

namespace tribode {
namespace {

TEST(MethodList, HasEveryMethodInOrder) {
    ASSERT_EQ(method_list().size(), SolverOptions::method_names().size());
    for (std::size_t i = 0; i < method_list().size(); ++i) {
        EXPECT_EQ(method_list()[i].method, static_cast<Method>(i));
    }
}

} // namespace
} // namespace tribode
