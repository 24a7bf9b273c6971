// The target that compiles the shared headers wants a source.
