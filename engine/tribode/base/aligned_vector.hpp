#pragma once
#include <cstddef>
#include <new>
#include <vector>

namespace tribode {

template <class Value>
struct CacheLineAllocator {
    using value_type = Value;

    CacheLineAllocator() = default;
    template <class Other>
    CacheLineAllocator(const CacheLineAllocator<Other>&) {}

    Value* allocate(std::size_t count) {
        return static_cast<Value*>(::operator new (count * sizeof(Value), std::align_val_t{64}));
    }
    void deallocate(Value* values, std::size_t) { ::operator delete (values, std::align_val_t{64}); }
    friend bool operator==(const CacheLineAllocator&, const CacheLineAllocator&) { return true; }
};

// A vector that begins where a cache line does: eight numbers at a time are then in one line.
template <class Value>
using AlignedVector = std::vector<Value, CacheLineAllocator<Value>>;

} // namespace tribode
