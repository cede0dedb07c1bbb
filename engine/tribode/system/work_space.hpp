#pragma once
#include <cstddef>
#include <memory>
#include <type_traits>

namespace tribode {

// Memory for the intermediate values of one evaluation, uninitialized: on the stack up to `usual` values, beyond that on the
// heap. So functions that evaluate a constant system keep nothing between calls and serve several threads.
template <class Value, std::size_t usual>
class WorkSpace {
    static_assert(std::is_trivially_copyable_v<Value> && std::is_trivially_destructible_v<Value>);

  public:
    explicit WorkSpace(std::size_t size)
        : large_(size > usual ? new std::byte[size * sizeof(Value)] : nullptr),
          data_(reinterpret_cast<Value*>(large_ ? large_.get() : small_)) {}
    WorkSpace(const WorkSpace&) = delete;
    WorkSpace& operator=(const WorkSpace&) = delete;

    Value* data() { return data_; }

  private:
    std::unique_ptr<std::byte[]> large_;
    Value* data_;
    alignas(Value) std::byte small_[usual * sizeof(Value)];
};

} // namespace tribode
