#pragma once

#include <string>

#include "engine/graph.h"

namespace raymeld::cli {

// A line for each dispatch, with '|' where a barrier comes before it.
std::string passes_text(const Graph& graph);

// A line for each tensor: where it lies in the activation block, and from which dispatch to which. Then the
// sums, with and without aliasing. The graph must be planned.
std::string memory_text(const Graph& graph);

// In Graphviz's language.
std::string graph_dot(const Graph& graph, const std::string& name);

}  // namespace raymeld::cli
