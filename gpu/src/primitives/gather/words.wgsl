// The unit of a gather: one word, whatever it means.
alias Unit = u32;
