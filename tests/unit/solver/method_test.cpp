#include "tribode/solver/method.hpp"

#include <gtest/gtest.h>

namespace tribode {
namespace {

TEST(MethodList, HasEveryMethodInOrder) {
    ASSERT_EQ(method_list().size(), static_cast<std::size_t>(Method::zoh) + 1);
    for (std::size_t i = 0; i < method_list().size(); ++i) {
        EXPECT_EQ(method_list()[i].method, static_cast<Method>(i));
    }
}

} // namespace
} // namespace tribode
