// Control steps of an exported policy: plat_policy bundle < steps.jsonl > targets.jsonl
//
// A line of input is an object with "state", "keyframe" and "steps_left", as in the bundle's example.json; its
// "last_action" takes the place of the one that was computed last. A line of output is the list of joint position
// targets (rad), or {"error": ...}: motors then hold their last targets. Keyframes are whole poses. docs/deploy.md says
// what an observation is made of.
#include <algorithm>
#include <array>
#include <cmath>
#include <fstream>
#include <iostream>
#include <map>
#include <nlohmann/json.hpp>
#include <onnxruntime_cxx_api.h>
#include <stdexcept>
#include <string>
#include <vector>

using json = nlohmann::json;
using std::runtime_error;
using Numbers = std::vector<double>;
using Vector = std::array<double, 3>;
using Matrix = std::array<Vector, 3>;  // of columns: the axes of a frame, seen from its parent
struct Frame { Matrix axes; Vector origin; };

Vector rotate(const Matrix& m, const Vector& v) {
    Vector out{};
    for (int i = 0; i < 9; ++i) out[i % 3] += m[i / 3][i % 3] * v[i / 3];
    return out;
}
Vector rotate_back(const Matrix& m, const Vector& v) {
    Vector out{};
    for (int i = 0; i < 9; ++i) out[i / 3] += m[i / 3][i % 3] * v[i % 3];
    return out;
}
Vector minus(const Vector& a, const Vector& b) { return {a[0] - b[0], a[1] - b[1], a[2] - b[2]}; }
Frame within(const Frame& parent, const Frame& child) {
    Frame out{{}, rotate(parent.axes, child.origin)};
    for (int i = 0; i < 3; ++i) out.axes[i] = rotate(parent.axes, child.axes[i]), out.origin[i] += parent.origin[i];
    return out;
}
Matrix rotation(double w, double x, double y, double z) {
    const double n = w * w + x * x + y * y + z * z, s = 2 / n;
    if (!(std::abs(std::sqrt(n) - 1) < 0.01)) throw runtime_error("a quaternion is not of unit length");
    return {{{1 - s * (y * y + z * z), s * (x * y + w * z), s * (x * z - w * y)},
             {s * (x * y - w * z), 1 - s * (x * x + z * z), s * (y * z + w * x)},
             {s * (x * z + w * y), s * (y * z - w * x), 1 - s * (x * x + y * y)}}};
}
json parsed(const std::string& file) {
    std::ifstream stream(file);
    if (!stream) throw runtime_error(file + ": cannot be read, expected a file of the bundle");
    return json::parse(stream);
}
Numbers numbers(const json& object, const char* field, size_t size) {
    auto values = object.at(field).get<Numbers>();
    if (values.size() != size) throw runtime_error(field + (": expected " + std::to_string(size)) + " numbers");
    return values;
}
Frame frame(const json& object, const char* pos, const char* quat) {
    const auto p = numbers(object, pos, 3), q = numbers(object, quat, 4);
    return {rotation(q[0], q[1], q[2], q[3]), {p[0], p[1], p[2]}};
}

class Policy {
   public:
    explicit Policy(const std::string& folder)
        : bundle_(parsed(folder + "/bundle.json")), robot_(bundle_.at("robot")),
          session_(environment_, (folder + "/policy.onnx").c_str(), Ort::SessionOptions{}),
          rest_(robot_.at("default_joint_pos").get<Numbers>()), scale_(numbers(robot_, "action_scale", rest_.size())),
          last_action_(rest_.size(), 0.0) {
        if (bundle_.at("format") != "plat-bundle" || bundle_.at("version") != 1)
            throw runtime_error("bundle.json: not a bundle of version 1");
    }

    std::vector<float> step(const json& given) {
        const size_t joints = rest_.size();
        const json &state = given.at("state"), &keyframe = given.at("keyframe");
        double steps_left = given.at("steps_left");
        const double max_steps = bundle_.at("command").at("max_steps"), dt = bundle_.at("control_dt");
        if (keyframe.contains("commands")) throw runtime_error("keyframe: whole poses only");
        if (!(steps_left > 0 && steps_left <= max_steps + 1e-3)) throw runtime_error("steps_left: out of range");
        // times in seconds do not divide evenly: 0.06 s may be 3.0000000003 steps, and the arrival window has 3
        const double whole = std::round(steps_left);
        if (whole > 0 && std::abs(steps_left - whole) < 1e-3) steps_left = whole;
        const Frame root = frame(state, "root_pos_w", "root_quat_w"), target = frame(keyframe, "root_pos", "root_quat");
        const auto angles = numbers(keyframe, "joint_pos", joints);
        std::map<std::string, Numbers> terms;
        terms["robot.joint_pos"] = numbers(state, "joint_pos", joints);
        for (size_t j = 0; j < joints; ++j) terms["robot.joint_pos"][j] -= rest_[j];
        terms["robot.joint_vel"] = numbers(state, "joint_vel", joints);
        terms["robot.root_ang_vel_b"] = numbers(state, "root_ang_vel_b", 3);
        terms["robot.root_lin_vel_b"] = numbers(state, "root_lin_vel_b", 3);
        for (const Vector& axis : root.axes) terms["robot.gravity_b"].push_back(-axis[2]);
        terms["robot.last_action"] =
            given.contains("last_action") ? numbers(given, "last_action", joints) : last_action_;
        terms["goal.joint_pos"] = angles;
        for (double x : rotate_back(root.axes, minus(target.origin, root.origin)))
            terms["goal.root_pos_b"].push_back(x);
        for (int i = 0; i < 2; ++i)
            for (double x : rotate_back(root.axes, target.axes[i])) terms["goal.root_rot6d_b"].push_back(x);
        for (const Vector& point : keypoints(target, angles))
            for (double x : rotate_back(root.axes, minus(point, root.origin)))
                terms["goal.keypoint_pos_b"].push_back(x);
        terms["command.horizon"] = {steps_left / max_steps};
        terms["parts.joints"] = Numbers(joints, 1.0);
        terms["parts.bodies"] = Numbers(robot_.at("keypoints").size(), 1.0);
        terms["parts.root"] = Numbers(3, 1.0);
        terms["clock.soon"] = {std::min(steps_left * dt / 0.2, 1.0)};
        terms["clock.in_window"] = {steps_left <= bundle_.at("command").value("window", 3) ? 1.0 : 0.0};
        std::vector<float> observation;
        for (const json& term : bundle_.at("observation").at("terms")) {
            const Numbers& values = terms.at(term.at("name"));  // throws for a term that this program does not know
            if (term.at("start") != observation.size() || term.at("stop") != observation.size() + values.size())
                throw runtime_error("bundle.json: a term of the observation is of another size");
            observation.insert(observation.end(), values.begin(), values.end());
        }
        for (float value : observation)
            if (!(std::abs(value) < 1e15F)) throw runtime_error("state or keyframe: no robot measures such numbers");
        return run(observation);
    }

   private:
    std::vector<Vector> keypoints(const Frame& root, const Numbers& angles) const {
        std::map<std::string, Vector> places;
        std::vector<Frame> frames;
        for (const json& body : robot_.at("bodies")) {
            const int parent = body.at("parent"), joint = body.at("joint");
            Frame here = parent < 0 ? root : within(frames.at(parent), frame(body, "pos", "quat"));
            if (joint >= 0) {
                const auto axis = numbers(body, "axis", 3);
                const double half = 0.5 * angles.at(joint), s = std::sin(half);
                here = within(here, {rotation(std::cos(half), s * axis[0], s * axis[1], s * axis[2]), {}});
            }
            frames.push_back(here);
            places[body.at("name")] = here.origin;
        }
        std::vector<Vector> points;
        for (const std::string name : robot_.at("keypoints")) points.push_back(places.at(name));
        return points;
    }

    std::vector<float> run(std::vector<float>& observation) {
        const std::array<int64_t, 2> shape{1, static_cast<int64_t>(observation.size())};
        const auto memory = Ort::MemoryInfo::CreateCpu(OrtArenaAllocator, OrtMemTypeDefault);
        auto input = Ort::Value::CreateTensor<float>(memory, observation.data(), observation.size(), shape.data(), 2);
        const char *in = "observation", *out = "joint_position_target";
        auto output = session_.Run(Ort::RunOptions{nullptr}, &in, &input, 1, &out, 1);
        const float* values = output[0].GetTensorData<float>();
        std::vector<float> targets(values, values + rest_.size());
        for (float target : targets)
            if (!std::isfinite(target)) throw runtime_error("a target is not finite");
        for (size_t j = 0; j < rest_.size(); ++j) last_action_[j] = (targets[j] - rest_[j]) / scale_[j];
        return targets;
    }

    json bundle_, robot_;
    Ort::Env environment_;
    Ort::Session session_;
    Numbers rest_, scale_, last_action_;
};

int main(int count, char** arguments) try {
    if (count != 2) throw runtime_error("expected one argument, the folder of a bundle");
    Policy policy(arguments[1]);
    for (std::string line; std::getline(std::cin, line);) try {
            std::cout << json(policy.step(json::parse(line))) << std::endl;
        } catch (const std::exception& error) {
            std::cout << json{{"error", error.what()}} << std::endl;
        }
} catch (const std::exception& error) {
    std::cerr << "plat_policy: " << error.what() << std::endl;
    return 1;
}
