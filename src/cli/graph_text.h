#pragma once

#include <string>

#include "engine/graph.h"

namespace raymeld::cli {

// Returns a line for each dispatch, with '|' if a barrier comes before it.
std::string passes_text(const Graph& graph);

// Returns a line for each tensor, with its offset in the activation block and its first and last dispatch,
// and then the sums with and without aliasing. The graph must be planned.
std::string memory_text(const Graph& graph);

// Returns the graph in Graphviz's language.
std::string graph_dot(const Graph& graph, const std::string& name);

}  // namespace raymeld::cli
