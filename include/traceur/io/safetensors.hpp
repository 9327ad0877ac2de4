// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <bit>
#include <cmath>
#include <concepts>
#include <cstdint>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <limits>
#include <map>
#include <set>
#include <span>
#include <string>
#include <string_view>
#include <system_error>
#include <utility>
#include <vector>

#include <Eigen/Core>

#include <traceur/io/atomic_file.hpp>
#include <traceur/io/detail/json.hpp>
#include <traceur/nn/module.hpp>

namespace traceur::io {

/// What can be put into a tensor and taken out of one: F32, F64, I64 and I8.
template <class T>
concept TensorScalar = std::same_as<T, float> || std::same_as<T, double> || std::same_as<T, std::int64_t> || std::same_as<T, std::int8_t>;

/// An array of the safetensors format: its shape, outermost dimension first, and its bytes, row-major and little-endian.
struct Tensor {
  std::string name;
  std::string type;  ///< the format's name of the element type: "F32"
  std::vector<std::uint64_t> shape;
  std::string bytes;

  /// Elements; 1 if the shape is empty.
  std::uint64_t size() const noexcept {
    std::uint64_t n = 1;
    for (const std::uint64_t d : shape) n *= d;
    return n;
  }
};

namespace detail {

inline constexpr std::uint64_t largest_tensor_header = 100'000'000;
inline constexpr std::uint64_t largest_tensor_file = std::uint64_t{16} << 30;
inline constexpr std::string_view tensor_metadata = "__metadata__";

/// Bytes of an element; 0 for a type the format does not have.
inline std::uint64_t tensor_element(std::string_view type) noexcept {
  for (const char* name : {"F64", "I64", "U64"})
    if (type == name) return 8;
  for (const char* name : {"F32", "I32", "U32"})
    if (type == name) return 4;
  for (const char* name : {"F16", "BF16", "I16", "U16"})
    if (type == name) return 2;
  for (const char* name : {"BOOL", "U8", "I8", "F8_E5M2", "F8_E4M3"})
    if (type == name) return 1;
  return 0;
}

template <TensorScalar T>
constexpr const char* tensor_type() noexcept {
  if constexpr (std::same_as<T, float>) {
    return "F32";
  } else if constexpr (std::same_as<T, double>) {
    return "F64";
  } else if constexpr (std::same_as<T, std::int8_t>) {
    return "I8";
  } else {
    return "I64";
  }
}

inline std::string tensor_where(const std::string& where, std::string_view name) {
  return where + ": tensor " + shown(name);
}

inline std::string shape_text(const std::vector<std::uint64_t>& shape) {
  std::string out = "[";
  for (std::size_t i = 0; i < shape.size(); ++i) out += (i == 0 ? "" : ", ") + std::to_string(shape[i]);
  return out + "]";
}

/// Bytes of an array, or false when they are more than 2^64 - 1.
inline bool tensor_bytes(const std::vector<std::uint64_t>& shape, std::uint64_t element, std::uint64_t& bytes) noexcept {
  constexpr std::uint64_t most = std::numeric_limits<std::uint64_t>::max();
  const auto times = [](std::uint64_t a, std::uint64_t b, std::uint64_t& product) {
    if (b != 0 && a > most / b) return false;
    product = a * b;
    return true;
  };
  std::uint64_t n = 1;
  for (const std::uint64_t d : shape)
    if (!times(n, d, n)) return false;
  return times(n, element, bytes);
}

template <class T>
void append_little_endian(std::string& out, T value) {
  char bytes[sizeof(T)];
  std::memcpy(bytes, &value, sizeof(T));
  if constexpr (std::endian::native == std::endian::big) std::reverse(bytes, bytes + sizeof(T));
  out.append(bytes, sizeof(T));
}

template <class T>
T from_little_endian(const char* at) noexcept {
  char bytes[sizeof(T)];
  std::memcpy(bytes, at, sizeof(T));
  if constexpr (std::endian::native == std::endian::big) std::reverse(bytes, bytes + sizeof(T));
  T value;
  std::memcpy(&value, bytes, sizeof(T));
  return value;
}

}  // namespace detail

/// The content of one safetensors file: tensors by name, in the order of their bytes, and a map of texts. The format is
/// that of huggingface.co/docs/safetensors: no code, no compression, read by every framework.
class Safetensors {
public:
  /// `where` begins messages: the path of the file.
  explicit Safetensors(std::string where = "safetensors") : where_(std::move(where)) {}

  const std::string& where() const noexcept { return where_; }

  /// Free texts: what the numbers are, the seed, the version.
  std::map<std::string, std::string> metadata;

  const std::vector<Tensor>& tensors() const noexcept { return tensors_; }

  /// Null if there is none of that name.
  const Tensor* find(std::string_view name) const {
    const auto found = index_.find(name);
    return found == index_.end() ? nullptr : &tensors_[found->second];
  }

  /// Throws Error if there is none of that name.
  const Tensor& at(std::string_view name) const {
    const Tensor* const tensor = find(name);
    if (!tensor) throw Error(detail::tensor_where(where_, name) + ": missing");
    return *tensor;
  }

  /// Adds a tensor of any of the format's types. Throws Error if the name is taken or reserved, the type unknown, or the
  /// bytes are not as many as type and shape ask for.
  void add(Tensor tensor) {
    const std::string here = detail::tensor_where(where_, tensor.name);
    if (tensor.name == detail::tensor_metadata) throw Error(here + ": the name is reserved");
    const std::uint64_t element = detail::tensor_element(tensor.type);
    if (element == 0) throw Error(here + ": unknown type " + detail::shown(tensor.type));
    std::uint64_t bytes = 0;
    if (!detail::tensor_bytes(tensor.shape, element, bytes) || bytes != tensor.bytes.size()) {
      throw Error(here + ": expected as many bytes as " + tensor.type + " " + detail::shape_text(tensor.shape) +
                  " takes, got " + std::to_string(tensor.bytes.size()));
    }
    if (!index_.emplace(tensor.name, tensors_.size()).second) throw Error(here + ": added twice");
    tensors_.push_back(std::move(tensor));
  }

  /// Adds a tensor of the values, row-major. Throws Error as above.
  template <TensorScalar T>
  void add(std::string name, std::vector<std::uint64_t> shape, std::span<const T> values) {
    Tensor tensor{std::move(name), detail::tensor_type<T>(), std::move(shape), {}};
    tensor.bytes.reserve(values.size_bytes());
    for (const T value : values) detail::append_little_endian(tensor.bytes, value);
    add(std::move(tensor));
  }

  /// Copies a tensor of `out.size()` elements, row-major; an F32 tensor may be read as double. Throws Error if it is missing
  /// or of another type or size.
  template <TensorScalar T>
  void read(std::string_view name, std::span<T> out) const {
    const Tensor& tensor = at(name);
    const auto refuse = [&](const std::string& reason) { throw Error(detail::tensor_where(where_, name) + reason); };
    if (tensor.size() != out.size()) {
      refuse(": expected " + std::to_string(out.size()) + " elements, found " + detail::shape_text(tensor.shape));
    }
    if (tensor.type == detail::tensor_type<T>()) {
      for (std::size_t i = 0; i < out.size(); ++i) {
        out[i] = detail::from_little_endian<T>(tensor.bytes.data() + i * sizeof(T));
      }
      return;
    }
    if constexpr (std::same_as<T, double>) {
      if (tensor.type == "F32") {
        for (std::size_t i = 0; i < out.size(); ++i) {
          out[i] = static_cast<double>(detail::from_little_endian<float>(tensor.bytes.data() + i * sizeof(float)));
        }
        return;
      }
    }
    refuse(": expected type " + std::string(detail::tensor_type<T>()) + ", found " + tensor.type);
  }

  /// The same, as a new vector.
  template <TensorScalar T>
  std::vector<T> values(std::string_view name) const {
    std::vector<T> out(static_cast<std::size_t>(at(name).size()));
    read<T>(name, out);
    return out;
  }

  /// Throws Error that names the first F32 or F64 tensor with a NaN or an infinity, which the format allows.
  void check_finite() const {
    for (const Tensor& tensor : tensors_) check_finite(tensor);
  }

  /// The same for one tensor.
  void check_finite(const Tensor& tensor) const {
    if (tensor.type == "F32") check_finite_as<float>(tensor);
    if (tensor.type == "F64") check_finite_as<double>(tensor);
  }

private:
  template <class T>
  void check_finite_as(const Tensor& tensor) const {
    for (std::size_t i = 0; i * sizeof(T) < tensor.bytes.size(); ++i) {
      if (!std::isfinite(detail::from_little_endian<T>(tensor.bytes.data() + i * sizeof(T)))) {
        throw Error(detail::tensor_where(where_, tensor.name) + ": expected finite numbers, element " +
                    std::to_string(i) + " is not");
      }
    }
  }

  std::string where_;
  std::vector<Tensor> tensors_;
  std::map<std::string, std::size_t, std::less<>> index_;
};

/// The bytes of a file: the header's length as 8 bytes, the header in JSON, filled up with blanks to a multiple of 8, and
/// the tensors, those of larger elements first so that each lies aligned, then by name: the same tensors give the same bytes
/// in whatever order they were added. Throws Error if a name or text is not UTF-8.
inline std::string safetensors_bytes(const Safetensors& file) {
  std::vector<const Tensor*> order;
  std::uint64_t size = 0;
  for (const Tensor& tensor : file.tensors()) {
    order.push_back(&tensor);
    size += tensor.bytes.size();
  }
  std::sort(order.begin(), order.end(), [](const Tensor* a, const Tensor* b) {
    const std::uint64_t left = detail::tensor_element(a->type), right = detail::tensor_element(b->type);
    return left != right ? left > right : a->name < b->name;
  });
  std::string header = "{";
  try {
    if (!file.metadata.empty()) {
      header += detail::Json(detail::tensor_metadata).dump() + ":" + detail::Json(file.metadata).dump();
    }
    std::uint64_t begin = 0;
    for (const Tensor* tensor : order) {
      const std::uint64_t end = begin + tensor->bytes.size();
      if (header.size() > 1) header += ",";
      header += detail::Json(tensor->name).dump() + ":{\"dtype\":\"" + tensor->type +
                "\",\"shape\":" + detail::Json(tensor->shape).dump() + ",\"data_offsets\":[" + std::to_string(begin) +
                "," + std::to_string(end) + "]}";
      begin = end;
    }
  } catch (const detail::Json::exception&) {
    throw Error(file.where() + ": expected names and metadata in UTF-8");
  }
  header += "}";
  header.resize((header.size() + 7) / 8 * 8, ' ');
  if (header.size() > detail::largest_tensor_header) throw Error(file.where() + ": header of more than 100 MB");
  std::string out;
  out.reserve(8 + header.size() + size);
  detail::append_little_endian(out, static_cast<std::uint64_t>(header.size()));
  out += header;
  for (const Tensor* tensor : order) out += tensor->bytes;
  return out;
}

namespace detail {

/// The header as JSON. Throws Error where it is not JSON, has a name twice in one object, or is deeper than any header.
inline Json parse_tensor_header(std::string_view header, const std::string& where) {
  if (header.empty() || header.front() != '{') throw Error(where + ": header: expected a JSON object");
  // To the parser a null byte is the end of the text, whatever comes after it.
  if (const std::size_t null = header.find('\0'); null != std::string_view::npos) {
    throw Error(where + ": header: not JSON at byte " + std::to_string(null + 1));
  }
  std::vector<std::set<std::string>> names;
  const auto follow = [&](int, Json::parse_event_t event, Json& parsed) {
    if (event == Json::parse_event_t::object_start) {
      if (names.size() == 3) throw Error(where + ": header: objects too deep");
      names.emplace_back();
    } else if (event == Json::parse_event_t::object_end) {
      names.pop_back();
    } else if (event == Json::parse_event_t::key) {
      const auto& name = parsed.get_ref<const std::string&>();
      if (!names.back().insert(name).second) throw Error(where + ": header: name " + shown(name) + " stands there twice");
    }
    return true;
  };
  try {
    return Json::parse(header.begin(), header.end(), follow);
  } catch (const Json::parse_error& e) {
    throw Error(where + ": header: not JSON at byte " + std::to_string(e.byte));
  } catch (const Json::exception&) {
    throw Error(where + ": header: not JSON: a number is too large");
  }
}

inline std::vector<std::uint64_t> to_naturals(const Json& value, const std::string& where) {
  std::vector<std::uint64_t> out;
  for (const Json& number : to_array(value, where)) {
    if (!number.is_number_unsigned()) throw Error(where + ": expected whole numbers of 0 or more");
    out.push_back(number.get<std::uint64_t>());
  }
  return out;
}

}  // namespace detail

/// Reads the bytes of a safetensors file, as strict as the format's reference implementation: the header is at most 100 MB,
/// lies within the file and is an object; metadata are texts; every type is known, every size that of type and shape; and the
/// tensors fill the rest of the file, without hole, overlap or remainder. A name that stands there twice is refused too.
/// NaN is a number like others here (see `Safetensors::check_finite`). Throws Error of one line that names `where` and the
/// tensor.
inline Safetensors parse_safetensors(std::string_view bytes, std::string where) {
  if (bytes.size() < 8) throw Error(where + ": expected 8 bytes with the header's length; is the file truncated?");
  const auto length = detail::from_little_endian<std::uint64_t>(bytes.data());
  if (length > detail::largest_tensor_header) {
    throw Error(where + ": expected a header of at most 100 MB, found a length of " + std::to_string(length));
  }
  if (length > bytes.size() - 8) {
    throw Error(where + ": header of " + std::to_string(length) + " bytes ends after the file; is it truncated?");
  }
  const detail::Json header = detail::parse_tensor_header(bytes.substr(8, static_cast<std::size_t>(length)), where);
  const std::string_view data = bytes.substr(8 + static_cast<std::size_t>(length));

  struct Entry {
    std::uint64_t begin, end;
    Tensor tensor;
  };
  Safetensors file(std::move(where));
  std::vector<Entry> entries;
  for (const auto& [name, value] : header.items()) {
    if (name == detail::tensor_metadata) {
      if (!value.is_object()) throw Error(file.where() + ": " + name + ": expected an object of texts");
      for (const auto& [key, text] : value.items()) {
        file.metadata[key] = detail::to_text(text, file.where() + ": " + name + " " + detail::shown(key));
      }
      continue;
    }
    const std::string here = detail::tensor_where(file.where(), name);
    Entry entry;
    entry.tensor.name = name;
    entry.tensor.type = detail::to_text(detail::member(value, "dtype", here), here + ": dtype");
    entry.tensor.shape = detail::to_naturals(detail::member(value, "shape", here), here + ": shape");
    const auto offsets = detail::to_naturals(detail::member(value, "data_offsets", here), here + ": data_offsets");
    if (offsets.size() != 2 || offsets[0] > offsets[1]) {
      throw Error(here + ": data_offsets: expected two numbers, a begin and an end");
    }
    entry.begin = offsets[0];
    entry.end = offsets[1];
    const std::uint64_t element = detail::tensor_element(entry.tensor.type);
    if (element == 0) throw Error(here + ": unknown dtype " + detail::shown(entry.tensor.type));
    std::uint64_t expected = 0;
    if (!detail::tensor_bytes(entry.tensor.shape, element, expected)) throw Error(here + ": shape: too large");
    if (entry.end - entry.begin != expected) {
      throw Error(here + ": data_offsets: expected " + std::to_string(expected) + " bytes, found " +
                  std::to_string(entry.end - entry.begin));
    }
    entries.push_back(std::move(entry));
  }
  std::sort(entries.begin(), entries.end(), [](const Entry& a, const Entry& b) {
    return std::pair(a.begin, a.end) < std::pair(b.begin, b.end);
  });
  std::uint64_t next = 0;
  for (Entry& entry : entries) {
    const std::string here = detail::tensor_where(file.where(), entry.tensor.name);
    if (entry.begin != next) {
      throw Error(here + ": data_offsets: expected to begin at " + std::to_string(next) + ", found " +
                  std::to_string(entry.begin) + (entry.begin < next ? ": tensors overlap" : ": a hole in the file"));
    }
    if (entry.end > data.size()) {
      throw Error(here + ": data_offsets: end at " + std::to_string(entry.end) + " of " + std::to_string(data.size()) +
                  " bytes of data; is the file truncated?");
    }
    next = entry.end;
    entry.tensor.bytes =
        data.substr(static_cast<std::size_t>(entry.begin), static_cast<std::size_t>(entry.end - entry.begin));
    file.add(std::move(entry.tensor));
  }
  if (next != data.size()) {
    throw Error(file.where() + ": " + std::to_string(data.size() - next) + " bytes at the end belong to no tensor");
  }
  return file;
}

/// Reads a safetensors file of up to 16 GiB. Throws Error that names path and tensor.
inline Safetensors read_safetensors(const std::filesystem::path& path) {
  std::error_code failure;
  const auto status = std::filesystem::status(path, failure);
  if (!std::filesystem::exists(status)) throw Error(path.string() + ": no such file");
  if (std::filesystem::is_directory(status)) throw Error(path.string() + ": expected a file, found a folder");
  std::ifstream in(path, std::ios::binary);
  if (!in) throw Error(path.string() + ": cannot be opened");
  std::string bytes;
  char piece[1 << 16];
  while (in.read(piece, sizeof piece) || in.gcount() > 0) {
    bytes.append(piece, static_cast<std::size_t>(in.gcount()));
    if (bytes.size() > detail::largest_tensor_file) throw Error(path.string() + ": larger than 16 GiB");
  }
  if (in.bad()) throw Error(path.string() + ": reading failed");
  return parse_safetensors(bytes, path.string());
}

/// Writes the file atomically. Throws Error that names the path.
inline void write_safetensors(const std::filesystem::path& path, const Safetensors& file) {
  write_atomically(path, safetensors_bytes(file));
}

/// Adds the numbers of a vector, or of a matrix in the order of its memory, as a tensor of one dimension.
template <class D>
  requires TensorScalar<typename D::Scalar>
void add_vector(Safetensors& file, std::string name, const Eigen::PlainObjectBase<D>& v) {
  const auto size = static_cast<std::size_t>(v.size());
  file.add<typename D::Scalar>(std::move(name), {size}, {v.data(), size});
}

/// The numbers of a tensor, row-major. Throws Error as `Safetensors::read` does.
template <TensorScalar S>
Eigen::Matrix<S, Eigen::Dynamic, 1> get_vector(const Safetensors& file, std::string_view name) {
  Eigen::Matrix<S, Eigen::Dynamic, 1> v(static_cast<Eigen::Index>(file.at(name).size()));
  file.read<S>(name, {v.data(), static_cast<std::size_t>(v.size())});
  return v;
}

/// The same for a tensor that has to have `size` numbers, all finite: throws Error when it has not.
template <TensorScalar S>
Eigen::Matrix<S, Eigen::Dynamic, 1> get_vector(const Safetensors& file, std::string_view name, Eigen::Index size) {
  Eigen::Matrix<S, Eigen::Dynamic, 1> v(size);
  file.read<S>(name, {v.data(), static_cast<std::size_t>(size)});
  file.check_finite(file.at(name));
  return v;
}

/// Adds the parameters of a module, or of another network, each tensor under `prefix` and its name: a matrix as [rows, cols],
/// one column as [rows].
template <TensorScalar S, nn::Parameterized M>
void add_module(Safetensors& file, const M& module, const S* theta, const std::string& prefix = "") {
  std::vector<S> values;
  module.for_each_parameter([&](std::string_view name, Eigen::Index offset, Eigen::Index rows, Eigen::Index cols) {
    values.resize(static_cast<std::size_t>(rows * cols));
    const Eigen::Map<const Eigen::Matrix<S, Eigen::Dynamic, Eigen::Dynamic>> matrix(theta + offset, rows, cols);
    for (Eigen::Index r = 0; r < rows; ++r) {
      for (Eigen::Index c = 0; c < cols; ++c) values[static_cast<std::size_t>(r * cols + c)] = matrix(r, c);
    }
    std::vector<std::uint64_t> shape{static_cast<std::uint64_t>(rows)};
    if (cols != 1) shape.push_back(static_cast<std::uint64_t>(cols));
    file.add<S>(prefix + std::string(name), std::move(shape), values);
  });
}

/// Reads the parameters of a module or another network into `theta`. The tensors under `prefix` must be those of the module and no others, of
/// its sizes and finite; a shape of more than two dimensions counts as a matrix of its first dimension by the rest, as
/// PyTorch stores a convolution. Float numbers may be read into doubles, not the other way. Throws Error that names file
/// and tensor; `theta` is then undefined.
template <TensorScalar S, nn::Parameterized M>
void read_module(const Safetensors& file, const M& module, S* theta, const std::string& prefix = "") {
  std::vector<S> values;
  std::set<std::string> known;
  module.for_each_parameter([&](std::string_view part, Eigen::Index offset, Eigen::Index rows, Eigen::Index cols) {
    const std::string name = prefix + std::string(part);
    const Tensor& tensor = file.at(name);
    const std::uint64_t first = tensor.shape.empty() ? 1 : tensor.shape[0];
    if (first != static_cast<std::uint64_t>(rows) || tensor.size() != static_cast<std::uint64_t>(rows * cols)) {
      throw Error(detail::tensor_where(file.where(), name) + ": expected shape [" + std::to_string(rows) +
                  (cols == 1 ? "" : ", " + std::to_string(cols)) + "], found " + detail::shape_text(tensor.shape));
    }
    file.check_finite(tensor);
    values.resize(static_cast<std::size_t>(rows * cols));
    file.read<S>(name, values);
    Eigen::Map<Eigen::Matrix<S, Eigen::Dynamic, Eigen::Dynamic>> matrix(theta + offset, rows, cols);
    for (Eigen::Index r = 0; r < rows; ++r) {
      for (Eigen::Index c = 0; c < cols; ++c) matrix(r, c) = values[static_cast<std::size_t>(r * cols + c)];
    }
    known.insert(name);
  });
  for (const Tensor& tensor : file.tensors()) {
    if (tensor.name.starts_with(prefix) && !known.contains(tensor.name)) {
      throw Error(detail::tensor_where(file.where(), tensor.name) + ": the module has no such parameter");
    }
  }
}

}  // namespace traceur::io
