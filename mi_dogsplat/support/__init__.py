"""What every room may use: errors, files, arrays, locks, memory, wording, and the choice of LLVM and variant."""
