#pragma once

/// Marks a place between two steps of the link protocol: `name` is "operation.step", the step that is done here.
///
/// A mark is one `nop`, and an entry in the section `pi_os_steps` of the file, which is not loaded: the address of the
/// `nop` (8 bytes) and the name, padded with zeros to a multiple of 8. The sweep of test/chaos_sweep.py stops a process
/// there and kills it; the model in test/crash_model has the same steps. No store moves across a mark.
#define PI_OS_STEP(name)                 \
  __asm__ volatile(                      \
      "990: nop\n"                       \
      ".pushsection pi_os_steps,\"?\"\n" \
      ".balign 8\n"                      \
      ".8byte 990b\n"                    \
      ".asciz \"" name                   \
      "\"\n"                             \
      ".balign 8\n"                      \
      ".popsection" ::                   \
          : "memory")
