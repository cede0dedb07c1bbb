# The shared library of functional mock-up units: the parts of the engine that run a model, without Lua, and with all they need
# linked in. The program carries it and puts a copy into each unit that it exports.
set(fmu_modules fmu_runtime machine effect analysis control plant friction system solver hybrid base)
foreach(module ${fmu_modules})
  set_target_properties(tribode_${module} PROPERTIES POSITION_INDEPENDENT_CODE ON)
  target_compile_options(tribode_${module} PRIVATE -fno-semantic-interposition -ffunction-sections)
  list(APPEND fmu_archives $<TARGET_FILE:tribode_${module}>)
endforeach()
# Of the analyses it takes single files, without the packages that the others need. (Clang only checks, and links nothing.)
if(NOT CMAKE_CXX_COMPILER_ID STREQUAL Clang)
  set_target_properties(tribode_analysis PROPERTIES UNITY_BUILD OFF)
endif()
target_include_directories(tribode_fmu_runtime SYSTEM PRIVATE ${PROJECT_SOURCE_DIR}/third_party/fmi)

set(fmu_library ${CMAKE_CURRENT_BINARY_DIR}/tribode_fmu.so)
add_library(tribode_fmu_library MODULE fmu_library/fmt.cpp)
set_target_properties(tribode_fmu_library PROPERTIES OUTPUT_NAME tribode_fmu PREFIX "" CXX_VISIBILITY_PRESET hidden
                      LIBRARY_OUTPUT_DIRECTORY ${CMAKE_CURRENT_BINARY_DIR})
list(TRANSFORM fmu_modules PREPEND tribode_)
add_dependencies(tribode_fmu_library ${fmu_modules})
# As files, so that nothing that they say of their own needs comes along: the shared libraries of the program.
foreach(library cvode ida arkode nvecserial sunmatrixdense sunmatrixsparse sunlinsoldense sunlinsolklu)
  list(APPEND fmu_archives $<TARGET_FILE:SUNDIALS::${library}_static>)
endforeach()
list(APPEND fmu_archives -l:libklu.a -l:libbtf.a -l:libamd.a -l:libcolamd.a -l:libsuitesparseconfig.a)
list(JOIN fmu_archives " " fmu_archives)
target_link_libraries(tribode_fmu_library PRIVATE
  "-Wl,--whole-archive $<TARGET_FILE:tribode_fmu_runtime> -Wl,--no-whole-archive -Wl,--start-group ${fmu_archives} -Wl,--end-group"
  m ${CMAKE_DL_LIBS})
set(exported ${CMAKE_CURRENT_SOURCE_DIR}/fmu_library/exported_symbols.map)
target_link_options(tribode_fmu_library PRIVATE LINKER:--version-script=${exported} LINKER:--gc-sections)
set_property(TARGET tribode_fmu_library APPEND PROPERTY LINK_DEPENDS ${exported})
foreach(module ${fmu_modules})
  set_property(TARGET tribode_fmu_library APPEND PROPERTY LINK_DEPENDS $<TARGET_FILE:${module}>)
endforeach()
if(NOT CMAKE_CXX_FLAGS_DEBUG MATCHES "-fsanitize" OR NOT CMAKE_BUILD_TYPE STREQUAL "Debug")
  target_link_options(tribode_fmu_library PRIVATE -static-libstdc++ -static-libgcc LINKER:--no-undefined LINKER:-s)
endif()

# Its bytes become part of the program.
add_dependencies(tribode_fmu tribode_fmu_library)
set_source_files_properties(tribode/fmu/shared_library.cpp PROPERTIES
  OBJECT_DEPENDS ${fmu_library} COMPILE_DEFINITIONS TRIBODE_FMU_LIBRARY="${fmu_library}")
