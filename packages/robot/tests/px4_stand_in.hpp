/* Stand-ins of what rans_agent.cpp uses of PX4: topics have the fields of PX4's .msg files that it uses. */
#pragma once
#include <cstdint>
#include <cstring>

typedef uint64_t hrt_abstime;
static hrt_abstime clock_now;
inline hrt_abstime hrt_absolute_time() { return clock_now; }
#define PX4_INFO(...)

struct vehicle_attitude_s { uint64_t timestamp, timestamp_sample; float q[4]; };
struct vehicle_angular_velocity_s { uint64_t timestamp, timestamp_sample; float xyz[3]; };
struct vehicle_local_position_s {
    uint64_t timestamp, timestamp_sample;
    bool xy_valid, z_valid, v_xy_valid, v_z_valid;
    float x, y, z, vx, vy, vz;
};
struct trajectory_setpoint6dof_s {
    uint64_t timestamp;
    float position[3], velocity[3], acceleration[3], jerk[3], quaternion[4], angular_velocity[3];
};
struct vehicle_control_mode_s {
    uint64_t timestamp;
    bool flag_armed, flag_control_offboard_enabled, flag_control_allocation_enabled;
};
struct offboard_control_mode_s {
    uint64_t timestamp;
    bool position, velocity, acceleration, attitude, body_rate, thrust_and_torque, direct_actuator;
};
struct actuator_motors_s {
    uint64_t timestamp, timestamp_sample;
    uint16_t reversible_flags;
    static constexpr uint8_t NUM_CONTROLS = 12;
    float control[12];
};

struct Topic { unsigned char data[256]; size_t size; };
static Topic topic_vehicle_attitude, topic_vehicle_angular_velocity, topic_vehicle_local_position,
    topic_trajectory_setpoint6dof, topic_vehicle_control_mode, topic_offboard_control_mode, topic_actuator_motors;
#define ORB_ID(name) &topic_##name

namespace uORB
{
struct Subscription {
    const Topic *topic;
    bool copy(void *to) { std::memcpy(to, topic->data, topic->size); return topic->size > 0; }
};
template <class T> struct Publication {
    Topic *topic;
    bool publish(const T &message) { std::memcpy(topic->data, &message, topic->size = sizeof message); return true; }
};
} // namespace uORB

namespace px4
{
struct wq_config_t {};
namespace wq_configurations { constexpr wq_config_t nav_and_controllers{}; }
class ScheduledWorkItem
{
public:
    void ScheduleOnInterval(uint32_t, uint32_t = 0) {}
    void ScheduleClear() {}
protected:
    ScheduledWorkItem(const char *, const wq_config_t &) {}
    virtual ~ScheduledWorkItem() = default;
    virtual void Run() = 0;
};
} // namespace px4
