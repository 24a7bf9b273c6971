// The target that compiles the shared headers needs a source file.
