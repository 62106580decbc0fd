# pi_runtime_embed_kernels(<target> <file.cl>...): compiles OpenCL sources into the target, so that programs need no
# files at run time. Each becomes `extern const char* const <stem>_cl` of namespace pi_runtime::kernels, declared in the
# generated header "kernel_sources.h".
function(pi_runtime_embed_kernels target)
  set(folder ${CMAKE_CURRENT_BINARY_DIR}/kernel_sources)
  set(header ${folder}/kernel_sources.h)
  set(declarations "")
  foreach(kernel ${ARGN})
    get_filename_component(stem ${kernel} NAME_WE)
    set_property(DIRECTORY APPEND PROPERTY CMAKE_CONFIGURE_DEPENDS ${kernel})
    file(READ ${kernel} text)
    # Compilers limit the length of one literal (C++ asks for 64 kB at least): pieces of lines.
    string(REPLACE "\n" "\n)cl\" R\"cl(" text "${text}")
    file(WRITE ${folder}/${stem}.cpp.new
      "#include \"kernel_sources.h\"\n\nconst char* const pi_runtime::kernels::${stem}_cl = R\"cl(${text})cl\";\n")
    file(COPY_FILE ${folder}/${stem}.cpp.new ${folder}/${stem}.cpp ONLY_IF_DIFFERENT)
    target_sources(${target} PRIVATE ${folder}/${stem}.cpp)
    string(APPEND declarations "extern const char* const ${stem}_cl;\n")
  endforeach()
  file(WRITE ${header}.new
    "#pragma once\n\nnamespace pi_runtime\n{\nnamespace kernels\n{\n\n${declarations}\n}  // namespace kernels\n}  // namespace pi_runtime\n")
  file(COPY_FILE ${header}.new ${header} ONLY_IF_DIFFERENT)
  target_include_directories(${target} PRIVATE ${folder})
endfunction()
