// Tells whether a box touches a road edge; see `map_search.py`.

#include <cmath>

#include "batch.h"
#include "map.h"

namespace drivetrain {
namespace {

struct Box {
  float x, y, z, cos, sin, length, width;  // half the length and width
};

// Whether a segment and a box share a point, by separating axes.
inline bool touches(const Box& box, float start_x, float start_y, float end_x,
                    float end_y) {
  const float x = (start_x + end_x) / 2 - box.x, y = (start_y + end_y) / 2 - box.y;
  const float half_x = (end_x - start_x) / 2, half_y = (end_y - start_y) / 2;
  const float middle_along = box.cos * x + box.sin * y;
  const float middle_across = box.cos * y - box.sin * x;
  const float half_along = box.cos * half_x + box.sin * half_y;
  const float half_across = box.cos * half_y - box.sin * half_x;
  return (std::abs(middle_along) <= box.length + std::abs(half_along)) &
         (std::abs(middle_across) <= box.width + std::abs(half_across)) &
         (std::abs(middle_along * half_across - middle_across * half_along) <=
          box.length * std::abs(half_across) + box.width * std::abs(half_along));
}

template <typename T>
bool touches_edge(const Map<T>& map, const Box& box, int32_t num_edge_vertices,
                  float height) {
  bool found = false;
  map.for_each_piece(box.x, box.y, std::hypot(box.length, box.width), [&](int32_t piece) {
    if (piece >= num_edge_vertices || map.tag[piece] < kJoined) return;
    const int32_t end = piece + 1;
    const bool level = std::abs((map.z(piece) + map.z(end)) / 2 - box.z) <= height;
    found |= level & touches(box, map.x(piece), map.y(piece), map.x(end), map.y(end));
  });
  return found;
}

template <typename T>
void ask(ffi::ThreadPool pool, const ffi::RemainingArgs& args,
         const ffi::AnyBuffer& result, float height) {
  const BatchShape batch(result.dimensions(), 0);
  const Batched<const float> boxes(*args.get<ffi::AnyBuffer>(0), batch);
  const Batched<const int32_t> num_edge_vertices(*args.get<ffi::AnyBuffer>(1), batch);
  const Maps<T> maps(args, 2, batch);
  const Batched<const int32_t> index(*args.get<ffi::AnyBuffer>(2), batch);
  const Batched<bool> touched(result, batch);
  for_each(pool, batch, 32, [&](const Place& place) {
    const float* box = boxes.at(place);
    *touched.at(place) = touches_edge(
        maps.at(place), {box[0], box[1], box[2], box[3], box[4], box[5], box[6]},
        num_edge_vertices.at(place)[*index.at(place)], height);
  });
}

ffi::Error edge_contacts(ffi::ThreadPool pool, ffi::RemainingArgs args,
                         ffi::Result<ffi::AnyBuffer> touched, float height) {
  with_coordinates(args, 2, [&](auto coordinate) {
    ask<decltype(coordinate)>(pool, args, *touched, height);
  });
  return ffi::Error::Success();
}

}  // namespace

XLA_FFI_DEFINE_HANDLER_SYMBOL(drivetrain_edge_contacts, edge_contacts,
                              ffi::Ffi::Bind()
                                  .Ctx<ffi::ThreadPool>()
                                  .RemainingArgs()
                                  .Ret<ffi::AnyBuffer>()
                                  .Attr<float>("height"));

}  // namespace drivetrain
