// Control-C and termination, asked about between frames.
#pragma once

namespace isoskin {

/// From now on the first SIGINT or SIGTERM is only noted, so that the frame in work ends whole; a second one kills.
void catch_interrupts();

/// True once one has been noted.
bool interrupted();

}  // namespace isoskin
