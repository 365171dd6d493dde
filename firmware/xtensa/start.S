/* The simulator begins at the start of its system ROM. */
        .section .reset, "ax"
        .global reset
        .align  4
reset:
        j       begin
        .align  4
stack:  .word   stack_top
entry:  .word   start_on_stack
begin:
        l32r    a1, stack
        l32r    a0, entry
        jx      a0
