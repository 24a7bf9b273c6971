// Declares the function of each suite.
#pragma once

#include "conform/collector.h"

namespace raymeld::conform {

void conform_conv2d(Collector& collector);
void conform_exposure(Collector& collector);
void conform_encode(Collector& collector);
void conform_decode(Collector& collector);
void conform_pyramid(Collector& collector);
void conform_attention(Collector& collector);
void conform_kpcn(Collector& collector);
void conform_temporal(Collector& collector);
void conform_network(Collector& collector);

}  // namespace raymeld::conform
