// The unit of a gather: a row of four words, of any type.
alias Unit = vec4<u32>;
