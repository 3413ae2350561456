// What a run says in JSON: a line a frame, a line an event (design 10).
#pragma once

#include <nlohmann/json.hpp>

#include "core/tracker.h"

namespace isoskin {

using Json = nlohmann::ordered_json;

/// A line of report.jsonl; `bounds` is the field's box, by which cameras frame the frame. Angles are degrees: min, p1,
/// mean over each triangle's smallest angle; peak_bytes is this process's so far.
Json to_json(const FrameReport& report, const Box& bounds);

/// A line of ledger.jsonl.
Json to_json(const LedgerEntry& entry);

}  // namespace isoskin
