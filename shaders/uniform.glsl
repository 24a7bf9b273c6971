// n < 64, uniform. Drivers that find out by themselves which values are the same for all lanes know that push constants
// are, whatever their index: p.digits[i] is i. To be included behind the push constants.
uint uniform_number(uint n) { return 8 * p.digits[n / 8] + p.digits[n % 8]; }
