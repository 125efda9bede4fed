/* A vehicle of PX4 with the module, for tests: motions are position, quaternion (w first), velocity and spin. */
#include "rans_agent.cpp"

template <class T> void publish(Topic &topic, const T &message) { uORB::Publication<T>{&topic}.publish(message); }

/* Motors that are commanded after the module was stopped by its command, of those that are open now. */
extern "C" void motors_of_stop(float motors[12])
{
    actuator_motors_s open{};
    char name[] = "rans_agent", start[] = "start", stop[] = "stop";
    char *words[2][2] = {{name, start}, {name, stop}};
    publish(topic_actuator_motors, open);
    rans_agent_main(2, words[0]);
    rans_agent_main(2, words[1]);
    std::memcpy(motors, reinterpret_cast<actuator_motors_s *>(topic_actuator_motors.data)->control, 48);
}

/* Motors at a time, us, of an estimate at another time. A time of 0 begins anew. */
extern "C" void motors_of(uint64_t now, uint64_t sample, const float own[13], const float goal[13], float motors[12])
{
    static RansAgent agent;
    clock_now = now;
    if (now == 0) { publish(topic_vehicle_control_mode, vehicle_control_mode_s{}); agent.Run(); }
    publish(topic_vehicle_control_mode, vehicle_control_mode_s{now, true, true, false});
    publish(topic_vehicle_attitude, vehicle_attitude_s{now, sample, {own[3], own[4], own[5], own[6]}});
    publish(topic_vehicle_angular_velocity, vehicle_angular_velocity_s{now, sample, {own[10], own[11], own[12]}});
    publish(topic_vehicle_local_position, vehicle_local_position_s{now, sample, true, true, true, true,
            own[0], own[1], own[2], own[7], own[8], own[9]});
    trajectory_setpoint6dof_s setpoint{};
    std::memcpy(setpoint.position, goal, 12);
    std::memcpy(setpoint.quaternion, goal + 3, 16);
    std::memcpy(setpoint.velocity, goal + 7, 12);
    publish(topic_trajectory_setpoint6dof, setpoint);
    agent.Run();
    std::memcpy(motors, reinterpret_cast<actuator_motors_s *>(topic_actuator_motors.data)->control, 48);
}
