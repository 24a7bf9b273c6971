// Does with files what the standard library cannot. Functions that fail set errno and return -1, false or
// null.
#pragma once

#include <cstdint>
#include <cstdio>
#include <filesystem>

namespace raymeld {

// Returns whether this user may make files in a folder. Only the program asks, so Windows has no answer.
bool may_write_in(const std::filesystem::path& folder);

// Makes a file for writing that has no name yet; fails where the file system, or Windows, has no such files.
int make_unnamed_file(const std::filesystem::path& folder);

// Makes a file for writing with the permissions of any new file. Fails with EEXIST where the name is taken.
int make_file(const std::filesystem::path& path);

// Gives an unnamed file its name. Fails with EEXIST where the name is taken.
bool name_file(int unnamed, const std::filesystem::path& path);

// Brings a file, or the names in a folder, to the disk.
bool sync_file(int file);
void sync_folder(const std::filesystem::path& folder);

int copy_descriptor(int file);
void close_descriptor(int file);
std::FILE* stream_of(int file);  // a stream for writing; closing it closes the file
int descriptor_of(std::FILE* stream);

int64_t position_of(std::FILE* stream);
bool seek_to(std::FILE* stream, int64_t position);

}  // namespace raymeld
