/* A vehicle within PX4, for tests: reads motions from one pipe and writes what the module commands to another.
 * A line in: age of the estimate, ms; position, quaternion (w first), velocity and spin of the vehicle and of its goal,
 * in PX4's frames. A line out: twelve motors, of the module's first run after the estimate. */
#include <cstdio>
#include <cstring>

#include <drivers/drv_hrt.h>
#include <px4_platform_common/time.h>
#include <uORB/Publication.hpp>
#include <uORB/Subscription.hpp>
#include <uORB/topics/actuator_motors.h>
#include <uORB/topics/trajectory_setpoint6dof.h>
#include <uORB/topics/vehicle_angular_velocity.h>
#include <uORB/topics/vehicle_attitude.h>
#include <uORB/topics/vehicle_control_mode.h>
#include <uORB/topics/vehicle_local_position.h>

extern "C" __attribute__((visibility("default"))) int rans_vehicle_main(int argc, char *argv[]);

int rans_vehicle_main(int argc, char *argv[])
{
    if (argc != 3) { return 1; }

    FILE *motions = fopen(argv[1], "r");
    FILE *commands = fopen(argv[2], "w");

    if (motions == nullptr || commands == nullptr) { return 1; }

    uORB::Publication<vehicle_control_mode_s> control_pub{ORB_ID(vehicle_control_mode)};
    uORB::Publication<vehicle_attitude_s> attitude_pub{ORB_ID(vehicle_attitude)};
    uORB::Publication<vehicle_angular_velocity_s> spin_pub{ORB_ID(vehicle_angular_velocity)};
    uORB::Publication<vehicle_local_position_s> local_pub{ORB_ID(vehicle_local_position)};
    uORB::Publication<trajectory_setpoint6dof_s> goal_pub{ORB_ID(trajectory_setpoint6dof)};
    uORB::Subscription motors_sub{ORB_ID(actuator_motors)};
    float row[27];

    for (;;) {
        for (float &number : row) {
            if (fscanf(motions, "%f", &number) != 1) { fclose(commands); return 0; }
        }

        px4_usleep(50000);  // after the module's last run, so that the estimate is not as old as it may be at the next
        const float *own = row + 1;
        const float *goal = row + 14;
        const hrt_abstime now = hrt_absolute_time();
        const hrt_abstime sample = now - (hrt_abstime)(1000.F * row[0]);

        vehicle_control_mode_s control{};
        control.timestamp = now;
        control.flag_armed = true;
        control.flag_control_offboard_enabled = true;
        control_pub.publish(control);

        vehicle_attitude_s attitude{};
        attitude.timestamp = now;
        attitude.timestamp_sample = sample;
        memcpy(attitude.q, own + 3, sizeof attitude.q);
        attitude_pub.publish(attitude);

        vehicle_angular_velocity_s spin{};
        spin.timestamp = now;
        spin.timestamp_sample = sample;
        memcpy(spin.xyz, own + 10, sizeof spin.xyz);
        spin_pub.publish(spin);

        vehicle_local_position_s local{};
        local.timestamp = now;
        local.timestamp_sample = sample;
        local.xy_valid = local.z_valid = local.v_xy_valid = local.v_z_valid = true;
        local.x = own[0];
        local.y = own[1];
        local.z = own[2];
        local.vx = own[7];
        local.vy = own[8];
        local.vz = own[9];
        local_pub.publish(local);

        trajectory_setpoint6dof_s setpoint{};
        setpoint.timestamp = now;
        memcpy(setpoint.position, goal, sizeof setpoint.position);
        memcpy(setpoint.quaternion, goal + 3, sizeof setpoint.quaternion);
        memcpy(setpoint.velocity, goal + 7, sizeof setpoint.velocity);
        goal_pub.publish(setpoint);

        actuator_motors_s motors{};

        while (!motors_sub.update(&motors) || motors.timestamp < now) { px4_usleep(500); }

        for (float motor : motors.control) { fprintf(commands, "%.9g ", (double)motor); }

        fprintf(commands, "\n");
        fflush(commands);
    }
}
