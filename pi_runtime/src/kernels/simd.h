#pragma once

/// Marks a function whose loops the compiler shall vectorise for the processor at hand: compiled for several levels of
/// x86-64, the best of which is chosen when the program is loaded. Elsewhere the target of the build is used (NEON
/// belongs to every AArch64).
///
/// For small functions with plain, branch-free inner loops over restrict pointers. Functions that they call must be
/// inlined to profit. Floating-point results may differ in the last bit between levels (fused multiply-add), so keep
/// float arithmetic that must agree with other implementations outside.
///
/// Not under sanitizers: they are not ready yet when the choice is made.
#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__) && !defined(__SANITIZE_ADDRESS__) && \
    !defined(__SANITIZE_THREAD__)
#define PI_RUNTIME_SIMD_CLONES __attribute__((target_clones("default", "arch=x86-64-v3", "arch=x86-64-v4")))
#else
#define PI_RUNTIME_SIMD_CLONES
#endif

/// For helpers of such functions.
#define PI_RUNTIME_ALWAYS_INLINE inline __attribute__((always_inline))
