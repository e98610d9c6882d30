// Writes what an object sees of others and of the map around; see `compact.py`.

#include <cmath>
#include <vector>

#include "batch.h"
#include "map.h"
#include "nearest.h"

namespace drivetrain {
namespace {

constexpr int kFeatures = 7;
constexpr uint8_t kFirstEdge = 14, kLastEdge = 16;  // MapType
constexpr uint8_t kLastLane = 3;

struct Units {
  float length, speed, size;  // what one stands for
};

// The pose of the object that looks.
struct Frame {
  float x, y, cos, sin;
};

struct Objects {
  const float *xy, *direction, *speed, *size;
  const bool* valid;
  int64_t count;
};

// Writes the nearest others within the radius in the order of their numbers.
int32_t write_objects(const Objects& objects, const Frame& frame, int64_t own,
                      int64_t most, float radius, const Units& units, float* out) {
  thread_local std::vector<uint64_t> near, nearest;
  near.clear();
  for (int64_t i = 0; i < objects.count; ++i) {
    const float x = objects.xy[2 * i] - frame.x, y = objects.xy[2 * i + 1] - frame.y;
    const float squared = x * x + y * y;
    if (!objects.valid[i] || i == own || !(squared <= radius * radius)) continue;
    near.push_back(uint64_t{key_of(squared)} << 32 | static_cast<uint64_t>(i));
  }
  uint64_t last = ~uint64_t{0};
  if (static_cast<int64_t>(near.size()) > most) {
    nearest = near;
    std::nth_element(nearest.begin(), nearest.begin() + most - 1, nearest.end());
    last = nearest[most - 1];
  }
  int32_t count = 0;
  for (const uint64_t candidate : near) {
    if (candidate > last) continue;
    const int64_t i = candidate & 0xffffffff;
    const float x = objects.xy[2 * i] - frame.x, y = objects.xy[2 * i + 1] - frame.y;
    const float cos = objects.direction[2 * i], sin = objects.direction[2 * i + 1];
    float* features = out + kFeatures * count++;
    features[0] = (frame.cos * x + frame.sin * y) / units.length;
    features[1] = (frame.cos * y - frame.sin * x) / units.length;
    features[2] = frame.cos * cos + frame.sin * sin;
    features[3] = frame.cos * sin - frame.sin * cos;
    features[4] = objects.speed[i] / units.speed;
    features[5] = objects.size[2 * i] / units.size;
    features[6] = objects.size[2 * i + 1] / units.size;
  }
  return count;
}

// Lists the pieces of the tiles around, nearest tiles first.
template <typename T>
void list_road(const Map<T>& map, const Frame& frame, const int32_t* offsets,
               int64_t num_offsets, int64_t most, std::vector<int32_t>& listed) {
  listed.resize(most);
  const int own_column = map.column(frame.x), own_row = map.row(frame.y);
  int64_t total = 0;
  for (int64_t i = 0; i < num_offsets && total < most; ++i) {
    const int column = own_column + offsets[2 * i];
    const int row = own_row + offsets[2 * i + 1];
    if (column < 0 || column >= map.shape[0] || row < 0 || row >= map.shape[1]) continue;
    const int32_t* starts = map.starts + row * map.shape[0] + column;
    const int64_t count = std::min<int64_t>(most - total, starts[1] - starts[0]);
    std::copy_n(map.pieces + starts[0], count, listed.begin() + total);
    total += count;
  }
  listed.resize(total);
}

// Writes pieces of the map, some at once so that vectors of them are computed.
template <typename T>
void write_road(const Map<T>& map, const Frame& frame,
                const std::vector<int32_t>& listed, const Units& units, float* out) {
  constexpr int kAtOnce = 32;
  const float scale = 1 / units.length;
  const int total = static_cast<int>(listed.size());
  for (int first = 0; first < total; first += kAtOnce) {
    const int count = std::min(kAtOnce, total - first);
    T begin_x[kAtOnce] = {}, begin_y[kAtOnce] = {};
    T end_x[kAtOnce] = {}, end_y[kAtOnce] = {};
    uint8_t tag[kAtOnce] = {};
    for (int i = 0; i < count; ++i) {
      const int32_t piece = listed[first + i];
      tag[i] = map.tag[piece];
      const T* begin = map.vertices + 3 * piece;
      const T* end = map.vertices + 3 * map.end(piece);
      begin_x[i] = begin[0], begin_y[i] = begin[1];
      end_x[i] = end[0], end_y[i] = end[1];
    }
    float features[kFeatures][kAtOnce];
    for (int i = 0; i < kAtOnce; ++i) {
      const float start_x = map.metres(begin_x[i], 0), start_y = map.metres(begin_y[i], 1);
      const float half_x = (map.metres(end_x[i], 0) - start_x) / 2;
      const float half_y = (map.metres(end_y[i], 1) - start_y) / 2;
      const float x = start_x + half_x - frame.x, y = start_y + half_y - frame.y;
      const int type = tag[i] & (kJoined - 1);
      const float length = std::sqrt(half_x * half_x + half_y * half_y);
      const float along = 1 / std::max(length, 1e-6f);
      features[0][i] = (frame.cos * x + frame.sin * y) * scale;
      features[1][i] = (frame.cos * y - frame.sin * x) * scale;
      features[2][i] = (frame.cos * half_x + frame.sin * half_y) * along;
      features[3][i] = (frame.cos * half_y - frame.sin * half_x) * along;
      features[4][i] = length * scale;
      features[5][i] = (type >= kFirstEdge) & (type <= kLastEdge) ? 1.0f : 0.0f;
      features[6][i] = type <= kLastLane ? 1.0f : 0.0f;
    }
    float* rows = out + kFeatures * first;
    for (int i = 0; i < count; ++i) {
      for (int j = 0; j < kFeatures; ++j) rows[kFeatures * i + j] = features[j][i];
    }
  }
}

template <typename T>
void look(ffi::ThreadPool pool, const ffi::RemainingArgs& args,
          const ffi::RemainingRets& rets, float radius, const Units& units) {
  const auto operand = [&](size_t i) { return *args.get<ffi::AnyBuffer>(i); };
  const auto result = [&](size_t i) { return **rets.get<ffi::AnyBuffer>(i); };
  const BatchShape batch(result(1).dimensions(), 0);
  const Batched<const int32_t> numbers(operand(0), batch), offsets(operand(6), batch);
  const Batched<const float> xy(operand(1), batch), direction(operand(2), batch);
  const Batched<const float> speed(operand(3), batch), size(operand(4), batch);
  const Batched<const bool> valid(operand(5), batch);
  const Maps<T> maps(args, 7, batch);
  const Batched<float> objects(result(0), batch), road(result(2), batch);
  const Batched<int32_t> num_objects(result(1), batch), num_road(result(3), batch);
  for_each(pool, batch, 16, [&](const Place& place) {
    const int64_t own = clamped(*numbers.at(place), valid.length(0));
    const Objects all{xy.at(place),   direction.at(place), speed.at(place),
                      size.at(place), valid.at(place),     valid.length(0)};
    const Frame frame{all.xy[2 * own], all.xy[2 * own + 1], all.direction[2 * own],
                      all.direction[2 * own + 1]};
    float* seen_objects = objects.at(place);
    float* seen_road = road.at(place);
    int32_t count = 0, road_count = 0;
    if (all.valid[own]) {
      count = write_objects(all, frame, own, objects.length(0), radius, units,
                            seen_objects);
      thread_local std::vector<int32_t> listed;
      const Map<T> map = maps.at(place);
      list_road(map, frame, offsets.at(place), offsets.length(0), road.length(0),
                listed);
      write_road(map, frame, listed, units, seen_road);
      road_count = static_cast<int32_t>(listed.size());
    }
    std::fill(seen_objects + kFeatures * count,
              seen_objects + kFeatures * objects.length(0), 0.0f);
    std::fill(seen_road + kFeatures * road_count,
              seen_road + kFeatures * road.length(0), 0.0f);
    *num_objects.at(place) = count;
    *num_road.at(place) = road_count;
  });
}

ffi::Error compact_views(ffi::ThreadPool pool, ffi::RemainingArgs args,
                         ffi::RemainingRets rets, float radius, float length_unit,
                         float speed_unit, float size_unit) {
  with_coordinates(args, 7, [&](auto coordinate) {
    look<decltype(coordinate)>(pool, args, rets, radius,
                               {length_unit, speed_unit, size_unit});
  });
  return ffi::Error::Success();
}

}  // namespace

XLA_FFI_DEFINE_HANDLER_SYMBOL(drivetrain_compact_views, compact_views,
                              ffi::Ffi::Bind()
                                  .Ctx<ffi::ThreadPool>()
                                  .RemainingArgs()
                                  .RemainingRets()
                                  .Attr<float>("radius")
                                  .Attr<float>("length_unit")
                                  .Attr<float>("speed_unit")
                                  .Attr<float>("size_unit"));

}  // namespace drivetrain
