"""What every feature stands on: errors, options, progress, threads, units, checks, kept results.

Nothing here knows shapes. In come what callers give - numbers, text, arrays, callbacks - and out go
checked options and arrays, one sentence for each mistake (`errors`, `validation`), a bar that can
be cancelled (`progress`), work on all processors (`threads`), and results that are found again
(`kept`). `jit` compiles kernels and keeps them; the kernels and searches that several features
share are here as well: heaps, union-find and small systems (`_kernels`), the nearest of many
things (`box_tree`), and depth buffers (`_splat_kernels`, thesis 3.4).

Read `options` first: an algorithm is a function with a class of options, and all else follows from
that. A new kernel that only one feature calls belongs to that feature; it comes here when a second
one needs it.
"""
