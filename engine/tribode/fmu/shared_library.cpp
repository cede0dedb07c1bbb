#include "tribode/fmu/shared_library.hpp"

// The file as it is. A table of numbers in C++ would take the compiler minutes.
asm(".section .rodata\n"
    ".balign 16\n"
    ".globl tribode_fmu_library_begin, tribode_fmu_library_end\n"
    "tribode_fmu_library_begin: .incbin \"" TRIBODE_FMU_LIBRARY "\"\n"
    "tribode_fmu_library_end: .byte 0\n"
    ".text\n");
extern "C" const char tribode_fmu_library_begin[], tribode_fmu_library_end[];

namespace tribode {

std::string_view fmu_shared_library() {
    return {tribode_fmu_library_begin, static_cast<std::size_t>(tribode_fmu_library_end - tribode_fmu_library_begin)};
}

} // namespace tribode
