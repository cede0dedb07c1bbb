# cmake -D SOURCE=... -D OUTPUT=... -P write.cmake: the commit of the sources as a source file, which changes only with it.
set(commit "")
execute_process(COMMAND git -C "${SOURCE}" rev-parse --show-toplevel OUTPUT_VARIABLE top OUTPUT_STRIP_TRAILING_WHITESPACE
                ERROR_QUIET)
get_filename_component(source "${SOURCE}" REALPATH)
if(top STREQUAL source) # and not a repository that contains an unpacked archive
  execute_process(COMMAND git -C "${SOURCE}" describe --always --dirty --abbrev=12 --exclude=* OUTPUT_VARIABLE commit
                  OUTPUT_STRIP_TRAILING_WHITESPACE ERROR_QUIET)
endif()
configure_file("${CMAKE_CURRENT_LIST_DIR}/commit.cpp.in" "${OUTPUT}" @ONLY)
