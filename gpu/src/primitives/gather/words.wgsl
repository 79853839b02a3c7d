// The unit of a gather: one word, of any type.
alias Unit = u32;
