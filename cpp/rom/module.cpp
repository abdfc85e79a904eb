// Python module romgrl.rom._core: checks arrays, releases the GIL once per call, computes on raw pointers.
#include <cmath>
#include <string>
#include <utility>
#include <vector>

#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include "rom/batch.hpp"

namespace py = pybind11;
using romgrl::Batch;
using romgrl::Parameters;
using romgrl::Pose;

namespace {

// The data of a C-contiguous array of exactly this dtype and shape (columns 0: one-dimensional).
template <typename T>
T* data(py::array& array, const char* name, py::ssize_t rows, py::ssize_t columns, bool writeable) {
    const bool shaped = columns == 0 ? array.ndim() == 1 && array.shape(0) == rows
                                     : array.ndim() == 2 && array.shape(0) == rows && array.shape(1) == columns;
    constexpr int flags = py::array::c_style | py::detail::npy_api::NPY_ARRAY_ALIGNED_;
    if (!shaped || !array.dtype().equal(py::dtype::of<T>()) || (array.flags() & flags) != flags) {
        const std::string shape = std::to_string(rows) + (columns == 0 ? "," : ", " + std::to_string(columns));
        throw py::value_error(std::string(name) + " must be an aligned C-contiguous array of shape (" + shape + ") and dtype " +
                              std::string(py::str(py::dtype::of<T>())));
    }
    if (writeable && !array.writeable()) throw py::value_error(std::string(name) + " is read-only");
    return static_cast<T*>(const_cast<void*>(array.data()));
}

template <typename T>
void require_finite(const T* values, py::ssize_t count, const char* name) {
    for (py::ssize_t i = 0; i < count; ++i) {
        if (!std::isfinite(values[i])) throw py::value_error(std::string(name) + " must be finite");
    }
}

// The arrays that a step writes to, checked once.
class Buffers {
  public:
    Buffers(const Batch& batch, const py::dict& arrays) : worlds_(batch.worlds()), size_(batch.observation_size()) {
        bind(arrays, arrays_.observation, "observation", size_);
        bind(arrays, arrays_.reward, "reward", 0);
        bind(arrays, arrays_.terminated, "terminated", 0);
        bind(arrays, arrays_.truncated, "truncated", 0);
        bind(arrays, arrays_.final_observation, "final_observation", size_);
        bind(arrays, arrays_.features, "features", romgrl::kFeatures);
        bind(arrays, arrays_.reset_features, "reset_features", romgrl::kFeatures);
        bind(arrays, arrays_.contact, "contact", romgrl::kLegs);
        bind(arrays, arrays_.forward_velocity, "forward_velocity", 0);
        bind(arrays, arrays_.ground_force, "ground_force", romgrl::kLegs);
        bind(arrays, arrays_.hip_torque, "hip_torque", romgrl::kLegs);
        bind(arrays, arrays_.power, "power", 0);
        bind(arrays, arrays_.positive_power, "positive_power", 0);
        bind(arrays, arrays_.retraction_power, "retraction_power", 0);
        bind(arrays, arrays_.positive_retraction_power, "positive_retraction_power", 0);
        bind(arrays, arrays_.leg_motor_power, "leg_motor_power", 0);
        bind(arrays, arrays_.positive_leg_motor_power, "positive_leg_motor_power", 0);
        bind(arrays, arrays_.diverged, "diverged", 0);
    }

    const romgrl::StepArrays& of(const Batch& batch) const {
        if (batch.worlds() == worlds_ && batch.observation_size() == size_) return arrays_;
        throw py::value_error("the buffers were made for another batch");
    }

  private:
    template <typename T>
    void bind(const py::dict& arrays, T*& pointer, const char* name, py::ssize_t columns) {
        py::array array = arrays[name];
        pointer = data<T>(array, name, worlds_, columns, true);
        kept_.push_back(std::move(array));
    }

    py::ssize_t worlds_, size_;
    std::vector<py::array> kept_;  // keeps the memory alive
    romgrl::StepArrays arrays_{};
};

void step(Batch& batch, py::array actions, const Buffers& buffers) {
    const py::ssize_t n = batch.worlds();
    const float* action = data<float>(actions, "actions", n, batch.action_size(), false);
    require_finite(action, n * batch.action_size(), "actions");
    const romgrl::StepArrays& arrays = buffers.of(batch);
    py::gil_scoped_release release;
    batch.step(action, arrays);
}

// The loop of steps without Python, as a yardstick.
void repeat(Batch& batch, py::array actions, const Buffers& buffers, int steps) {
    const py::ssize_t n = batch.worlds();
    const float* action = data<float>(actions, "actions", n, batch.action_size(), false);
    require_finite(action, n * batch.action_size(), "actions");
    const romgrl::StepArrays& arrays = buffers.of(batch);
    py::gil_scoped_release release;
    for (int i = 0; i < steps; ++i) batch.step(action, arrays);
}

void observe(const Batch& batch, py::array observation, py::array features, py::array contact) {
    const py::ssize_t n = batch.worlds();
    float* o = data<float>(observation, "observation", n, batch.observation_size(), true);
    float* f = data<float>(features, "features", n, romgrl::kFeatures, true);
    bool* c = data<bool>(contact, "contact", n, romgrl::kLegs, true);
    py::gil_scoped_release release;
    batch.observe(o, f, c);
}

py::array_t<double> save(const Batch& batch) {
    py::array_t<double> states({static_cast<py::ssize_t>(batch.worlds()), py::ssize_t{romgrl::kState}});
    batch.save(states.mutable_data());
    return states;
}

void restore(Batch& batch, py::array states) {
    const double* values = data<double>(states, "states", batch.worlds(), romgrl::kState, false);
    batch.restore(values);
}

void begin_in(Batch& batch, py::array states, double share) {
    const py::ssize_t rows = states.ndim() == 2 ? states.shape(0) : 0;
    const double* values = data<double>(states, "states", rows, romgrl::kState, false);
    batch.begin_in(values, static_cast<int>(rows), share);
}

void bind_parameters(py::module_& module) {
    py::class_<Parameters> c(module, "Parameters");
    c.def(py::init<>());
#define ROW(type, name, ...) c.def_readwrite(#name, &Parameters::name);
    ROMGRL_PARAMETERS(ROW)
    ROMGRL_RESETS(ROW)
#undef ROW
    py::dict bounds;
#define ROW(type, name, value, least, most) bounds[#name] = py::make_tuple(type(value), least, most);
    ROMGRL_PARAMETERS(ROW)
#undef ROW
    module.attr("PARAMETERS") = bounds;
}

void bind_pose(py::module_& module) {
    py::class_<Pose>(module, "Pose")
        .def(py::init<>())
        .def_readwrite("x", &Pose::x)
        .def_readwrite("y", &Pose::y)
        .def_readwrite("vx", &Pose::vx)
        .def_readwrite("vy", &Pose::vy)
        .def_readwrite("pitch", &Pose::pitch)
        .def_readwrite("pitch_rate", &Pose::pitch_rate)
        .def_readwrite("hip_angle", &Pose::hip_angle)
        .def_readwrite("hip_rate", &Pose::hip_rate)
        .def_readwrite("leg_length", &Pose::leg_length)
        .def_readwrite("leg_rate", &Pose::leg_rate)
        .def_readwrite("extension", &Pose::extension)
        .def_readwrite("extension_rate", &Pose::extension_rate);
}

}  // namespace

PYBIND11_MODULE(_core, module) {
    module.doc() = "Spring-leg worlds, stepped in batches.";
    bind_parameters(module);
    bind_pose(module);
    module.attr("STATE_SIZE") = py::int_(romgrl::kState);
    module.attr("WALKER_SIZE") = py::int_(romgrl::kWalkerState);
    module.attr("FIRST_LEG") = py::int_(romgrl::kMotion);
    module.attr("LEG_SIZE") = py::int_(romgrl::kLegMotion);
    py::class_<Buffers>(module, "Buffers")
        .def(py::init<const Batch&, const py::dict&>(), py::arg("batch"), py::arg("arrays"));
    py::class_<Batch>(module, "Batch")
        .def(py::init<const Parameters&, int, int>(), py::arg("parameters"), py::arg("num_worlds"),
             py::arg("num_threads"))
        .def_property_readonly("num_worlds", &Batch::worlds)
        .def_property_readonly("observation_size", &Batch::observation_size)
        .def_property_readonly("action_size", &Batch::action_size)
        .def("seed", &Batch::seed, py::arg("seed"))
        .def("reset", &Batch::reset)
        .def("step", &step, py::arg("actions"), py::arg("buffers"))
        .def("repeat", &repeat, py::arg("actions"), py::arg("buffers"), py::arg("steps"))
        .def("observe", &observe, py::arg("observation"), py::arg("features"), py::arg("contact"))
        .def("place", &Batch::place, py::arg("world"), py::arg("pose"))
        .def("save", &save)
        .def("restore", &restore, py::arg("states"))
        .def("begin_in", &begin_in, py::arg("states"), py::arg("share"));
}
