/* The agent of agent.c as a module of PX4: the estimated motion and a setpoint in, motors out.
 *
 * Copy this folder to src/modules/rans_agent and set CONFIG_MODULES_RANS_AGENT=y for the board. On the vehicle:
 *
 *     rans_agent check     the golden pairs
 *     rans_agent start     then publish trajectory_setpoint6dof, choose offboard mode and arm
 *     rans_agent stop
 *
 * Motor k + 1 is thruster k of contract.json. The motors stop at the end, and while an estimate or the setpoint is missing, or an
 * estimate is older than the contract's readings.oldest. */
#include <cmath>
#include <cstring>
#include <initializer_list>

#include <drivers/drv_hrt.h>
#include <px4_platform_common/log.h>
#include <px4_platform_common/px4_work_queue/ScheduledWorkItem.hpp>
#include <uORB/Publication.hpp>
#include <uORB/Subscription.hpp>
#include <uORB/topics/actuator_motors.h>
#include <uORB/topics/offboard_control_mode.h>
#include <uORB/topics/trajectory_setpoint6dof.h>
#include <uORB/topics/vehicle_angular_velocity.h>
#include <uORB/topics/vehicle_attitude.h>
#include <uORB/topics/vehicle_control_mode.h>
#include <uORB/topics/vehicle_local_position.h>

#include "agent.h"

extern "C" int rans_agent_check(void);
extern "C" __attribute__((visibility("default"))) int rans_agent_main(int argc, char *argv[]);

namespace
{

constexpr uint32_t PERIOD = @PERIOD@;  // us
constexpr uint64_t OLDEST = @OLDEST@;  // us

/* Motion as the contract has it: position and velocity in W, spin in B, and the rotation matrix R_WB. */
struct Motion {
    float p[3];
    float v[3];
    float w[3];
    float R[3][3];
};

/* PX4's north-east-down and forward-right-down in the contract's W, east-north-up, and B, forward-left-up. */
Motion turned(const float p[3], const float v[3], const float w[3], const float q[4])
{
    const float half = std::sqrt(0.5F);
    const float a = half * (q[0] + q[3]);
    const float b = half * (q[1] + q[2]);
    const float c = half * (q[1] - q[2]);
    const float d = half * (q[0] - q[3]);
    return {
        {p[1], p[0], -p[2]},
        {v[1], v[0], -v[2]},
        {w[0], -w[1], -w[2]},
        {
            {1.F - 2.F * (c * c + d * d), 2.F * (b * c - a * d), 2.F * (b * d + a * c)},
            {2.F * (b * c + a * d), 1.F - 2.F * (b * b + d * d), 2.F * (c * d - a * b)},
            {2.F * (b * d - a * c), 2.F * (c * d + a * b), 1.F - 2.F * (b * b + c * c)},
        },
    };
}

void observe(const Motion &own, const Motion &goal, float observation[RANS_OBSERVATION])
{
    float turn[3][3] {};

    for (int i = 0; i < 9; ++i) {
        for (int k = 0; k < 3; ++k) {
            turn[i / 3][i % 3] += own.R[k][i / 3] * goal.R[k][i % 3];
        }
    }

    (void)turn;
    const float columns[RANS_OBSERVATION] = {
        @COLUMNS@
    };
    std::memcpy(observation, columns, sizeof columns);
}

class RansAgent : public px4::ScheduledWorkItem
{
public:
    RansAgent() : ScheduledWorkItem("rans_agent", px4::wq_configurations::nav_and_controllers)
    {
        rans_agent_reset(&_agent);
    }

    /* Shut is the last that is commanded, and more than once. */
    ~RansAgent() override
    {
        const float shut[RANS_COMMANDS] {};
        ScheduleClear();

        for (int k = 0; k < 3; ++k) {
            command(shut, hrt_absolute_time());
        }
    }

    void Run() override
    {
        // PX4 stays in offboard mode while somebody says what is commanded.
        const hrt_abstime now = hrt_absolute_time();
        offboard_control_mode_s mode{};
        mode.timestamp = now;
        mode.direct_actuator = true;
        _mode_pub.publish(mode);
        vehicle_control_mode_s control{};
        _control_sub.copy(&control);

        if (!control.flag_armed || !control.flag_control_offboard_enabled || control.flag_control_allocation_enabled) {
            rans_agent_reset(&_agent);
            return;
        }

        vehicle_attitude_s attitude{};
        vehicle_angular_velocity_s spin{};
        vehicle_local_position_s local{};
        trajectory_setpoint6dof_s goal{};
        bool known = _attitude_sub.copy(&attitude);
        known = _spin_sub.copy(&spin) && known;
        known = _local_sub.copy(&local) && known;
        known = _goal_sub.copy(&goal) && known;
        known = known && local.xy_valid && local.z_valid && local.v_xy_valid && local.v_z_valid;

        for (const hrt_abstime measured : {attitude.timestamp_sample, spin.timestamp_sample, local.timestamp_sample}) {
            known = known && measured + OLDEST >= now;
        }

        float answer[RANS_COMMANDS] {};

        if (known) {
            const float p[3] {local.x, local.y, local.z};
            const float v[3] {local.vx, local.vy, local.vz};
            float observation[RANS_OBSERVATION];
            observe(turned(p, v, spin.xyz, attitude.q),
                    turned(goal.position, goal.velocity, goal.angular_velocity, goal.quaternion), observation);
            rans_agent_act(&_agent, observation, answer);

        } else {
            rans_agent_reset(&_agent);
        }

        command(answer, attitude.timestamp_sample);
    }

private:
    void command(const float values[RANS_COMMANDS], hrt_abstime sample)
    {
        actuator_motors_s motors{};
        motors.timestamp = hrt_absolute_time();
        motors.timestamp_sample = sample;

        for (int k = 0; k < actuator_motors_s::NUM_CONTROLS; ++k) {
            motors.control[k] = k < RANS_COMMANDS && values[k] > 0.F ? values[k] : NAN;
        }

        _motors_pub.publish(motors);
    }

    rans_agent _agent;
    uORB::Subscription _attitude_sub{ORB_ID(vehicle_attitude)};
    uORB::Subscription _spin_sub{ORB_ID(vehicle_angular_velocity)};
    uORB::Subscription _local_sub{ORB_ID(vehicle_local_position)};
    uORB::Subscription _goal_sub{ORB_ID(trajectory_setpoint6dof)};
    uORB::Subscription _control_sub{ORB_ID(vehicle_control_mode)};
    uORB::Publication<offboard_control_mode_s> _mode_pub{ORB_ID(offboard_control_mode)};
    uORB::Publication<actuator_motors_s> _motors_pub{ORB_ID(actuator_motors)};
};

RansAgent *running = nullptr;

} // namespace

int rans_agent_main(int argc, char *argv[])
{
    const char *word = argc > 1 ? argv[1] : "";

    if (std::strcmp(word, "check") == 0) {
        return rans_agent_check();
    }

    if (std::strcmp(word, "start") == 0 && running == nullptr) {
        running = new RansAgent();
        running->ScheduleOnInterval(PERIOD);
        return 0;
    }

    if (std::strcmp(word, "stop") == 0) {
        delete running;
        running = nullptr;
        return 0;
    }

    PX4_INFO("rans_agent check, start (once) or stop; it is %s", running != nullptr ? "running" : "stopped");
    return 1;
}
