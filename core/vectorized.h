// Loops that are worth wider vectors than the oldest processors have.
#pragma once

/// Before a function of plain loops: compiled several times, and the widest vectors that the processor has are taken
/// when the program starts. Results are the same: floating-point contraction is off. Sanitizers do not bear it.
#if defined(__x86_64__) && defined(__gnu_linux__) && !defined(__clang__) && !defined(__SANITIZE_ADDRESS__) && \
    !defined(__SANITIZE_THREAD__)
#define ISOSKIN_VECTORIZED __attribute__((target_clones("arch=x86-64-v4", "arch=x86-64-v3", "default")))
#else
#define ISOSKIN_VECTORIZED
#endif
