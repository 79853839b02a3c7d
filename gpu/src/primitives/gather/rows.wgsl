// The unit of a gather: a row of four words, whatever they mean.
alias Unit = vec4<u32>;
