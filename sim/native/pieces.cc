// Finds the pieces of the map nearest to a point; see `map_search.py`.

#include <vector>

#include "batch.h"
#include "map.h"
#include "nearest.h"

namespace drivetrain {
namespace {

template <typename T>
void collect(const Map<T>& map, float x, float y, float radius, bool by_segment,
             std::vector<Candidate>& candidates) {
  candidates.clear();
  map.for_each_piece(x, y, radius, [&](int32_t piece) {
    const int32_t end = map.end(piece);
    const float start_x = map.x(piece), start_y = map.y(piece);
    const float along_x = map.x(end) - start_x, along_y = map.y(end) - start_y;
    const float offset_x = x - start_x, offset_y = y - start_y;
    const float squared_length = along_x * along_x + along_y * along_y;
    const float raw = (offset_x * along_x + offset_y * along_y) /
                      (squared_length > 0 ? squared_length : 1.0f);
    const float share = by_segment ? std::min(std::max(raw, 0.0f), 1.0f) : 0.0f;
    const float apart_x = offset_x - share * along_x;
    const float apart_y = offset_y - share * along_y;
    const float squared = apart_x * apart_x + apart_y * apart_y;
    if (squared <= radius * radius) candidates.push_back({key_of(squared), piece});
  });
}

template <typename T>
void search(ffi::ThreadPool pool, const ffi::RemainingArgs& args,
            const ffi::AnyBuffer& numbers, const ffi::AnyBuffer& counts, float radius,
            bool by_segment) {
  const BatchShape batch(counts.dimensions(), 0);
  const Batched<const float> points(*args.get<ffi::AnyBuffer>(0), batch);
  const Maps<T> maps(args, 1, batch);
  const Batched<int32_t> found(numbers, batch), num_found(counts, batch);
  const int64_t most = found.length(0);
  for_each(pool, batch, 4, [&](const Place& place) {
    thread_local std::vector<Candidate> candidates, spare;
    const float* point = points.at(place);
    collect(maps.at(place), point[0], point[1], radius, by_segment,
            candidates);
    sort(candidates, spare);
    const int64_t count = std::min<int64_t>(most, candidates.size());
    int32_t* out = found.at(place);
    for (int64_t i = 0; i < count; ++i) out[i] = candidates[i].number;
    std::fill(out + count, out + most, 0);
    *num_found.at(place) = static_cast<int32_t>(count);
  });
}

ffi::Error nearest_pieces(ffi::ThreadPool pool, ffi::RemainingArgs args,
                          ffi::Result<ffi::AnyBuffer> numbers,
                          ffi::Result<ffi::AnyBuffer> count, float radius,
                          bool by_segment) {
  with_coordinates(args, 1, [&](auto coordinate) {
    search<decltype(coordinate)>(pool, args, *numbers, *count, radius, by_segment);
  });
  return ffi::Error::Success();
}

}  // namespace

XLA_FFI_DEFINE_HANDLER_SYMBOL(drivetrain_nearest_pieces, nearest_pieces,
                              ffi::Ffi::Bind()
                                  .Ctx<ffi::ThreadPool>()
                                  .RemainingArgs()
                                  .Ret<ffi::AnyBuffer>()
                                  .Ret<ffi::AnyBuffer>()
                                  .Attr<float>("radius")
                                  .Attr<bool>("by_segment"));

}  // namespace drivetrain
