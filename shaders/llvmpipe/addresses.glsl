// Lets shaders find activations by their addresses: drivers for CPUs then make one vector instruction of the
// accesses of all lanes, and read two floats at the price of one.
#define ADDRESS(type, name) type name;
#define BUFFER(index, access, Block, element, name)
#define READ_PAIR(name, at) floats(Pairs(uint64_t(name)).v[(at) / 2])
#define WRITE_PAIR(name, at, values) Pairs(uint64_t(name)).v[(at) / 2] = pair(values)
