// Python module romgrl.humanoid._core: observations of many planar humanoids from their joint angles.
#include <cstdint>
#include <cstring>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include "humanoid/planar_bodies.hpp"

namespace py = pybind11;
using romgrl::Body;
using romgrl::kPosture;
using romgrl::Landmarks;
using romgrl::PlanarBodies;
using romgrl::Posture;
using romgrl::SolePoint;
using romgrl::Vector;

namespace {

constexpr int kAligned = py::detail::npy_api::NPY_ARRAY_ALIGNED_;

// In the place of MuJoCo's timer.
double no_time() { return 0.0; }

// Rows of joint values that may lie apart, each contiguous: views of a larger array of states.
struct Rows {
    Rows(const py::array_t<double>& array, py::ssize_t count, py::ssize_t columns, const char* name)
        : first(reinterpret_cast<const char*>(array.data())), stride(array.ndim() == 2 ? array.strides(0) : 0) {
        if (array.ndim() != 2 || array.shape(0) != count || array.shape(1) != columns ||
            array.strides(1) != static_cast<py::ssize_t>(sizeof(double)) || !(array.flags() & kAligned)) {
            throw py::value_error(std::string(name) + " must have shape (" + std::to_string(count) + ", " +
                                  std::to_string(columns) + ") and contiguous rows");
        }
    }

    const double* operator[](py::ssize_t row) const { return reinterpret_cast<const double*>(first + row * stride); }

    const char* first;
    py::ssize_t stride;
};

template <typename T>
T* writeable(py::array_t<T>& array, std::vector<py::ssize_t> shape, const char* name) {
    constexpr int flags = py::array::c_style | kAligned;
    bool fits = array.ndim() == static_cast<py::ssize_t>(shape.size()) && (array.flags() & flags) == flags;
    for (std::size_t k = 0; fits && k < shape.size(); ++k) fits = array.shape(k) == shape[k];
    if (!fits) throw py::value_error(std::string(name) + " has the wrong shape or is not contiguous and aligned");
    return array.mutable_data();
}

void observe(const PlanarBodies& bodies, const py::array_t<double>& qpos, const py::array_t<double>& qvel,
             const py::array_t<int, py::array::c_style>& columns, py::array_t<float> observation,
             py::array_t<double> posture) {
    if (!(columns.flags() & kAligned)) throw py::value_error("columns must be aligned");
    const py::ssize_t count = qpos.ndim() == 2 ? qpos.shape(0) : 0, width = columns.size();
    const int* column = columns.data();
    const Rows positions(qpos, count, bodies.joints(), "qpos"), velocities(qvel, count, bodies.joints(), "qvel");
    float* seen = writeable(observation, {count, width}, "observation");
    double* pose = writeable(posture, {count, kPosture}, "posture");
    for (py::ssize_t k = 0; k < width; ++k) {
        if (column[k] < 0 || column[k] >= bodies.observation_size()) throw py::value_error("no such column of the observation");
    }
    py::gil_scoped_release release;
    std::vector<float> all(bodies.observation_size());
    for (py::ssize_t row = 0; row < count; ++row) {
        const Posture taken = bodies.observe(positions[row], velocities[row], all.data());
        std::memcpy(pose + row * kPosture, &taken, sizeof taken);
        for (py::ssize_t k = 0; k < width; ++k) *seen++ = all[column[k]];
    }
}

using SoleRow = std::tuple<int, bool, Vector, double>;

PlanarBodies make(const std::vector<int>& parents, const std::vector<int>& joints, const std::vector<Vector>& offsets,
                  const std::vector<Vector>& x_axes, const std::vector<Vector>& z_axes, std::vector<double> rest, int left_ankle,
                  int right_ankle, int neck, int head, const std::vector<SoleRow>& soles) {
    std::vector<Body> bodies;
    for (std::size_t i = 0; i < parents.size(); ++i) {
        bodies.push_back({parents[i], joints.at(i), offsets.at(i), x_axes.at(i), z_axes.at(i)});
    }
    std::vector<SolePoint> points;
    for (const auto& [body, left, offset, radius] : soles) points.push_back({body, left, offset, radius});
    return {std::move(bodies), Landmarks{left_ankle, right_ankle, neck, head}, std::move(points), std::move(rest)};
}

}  // namespace

PYBIND11_MODULE(_core, module) {
    module.attr("POSTURE_SIZE") = kPosture;
    module.attr("NO_TIME") = reinterpret_cast<std::uintptr_t>(&no_time);
    py::class_<PlanarBodies>(module, "PlanarBodies")
        .def(py::init(&make), py::kw_only(), py::arg("parents"), py::arg("joints"), py::arg("offsets"),
             py::arg("x_axes"), py::arg("z_axes"), py::arg("rest"), py::arg("left_ankle"), py::arg("right_ankle"),
             py::arg("neck"), py::arg("head"), py::arg("soles"))
        .def("observe", &observe, py::arg("qpos").noconvert(), py::arg("qvel").noconvert(), py::arg("columns").noconvert(),
             py::arg("observation").noconvert(), py::arg("posture").noconvert());
}
