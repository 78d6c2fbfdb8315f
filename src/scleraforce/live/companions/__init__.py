"""The monitor's other processes: black box, second opinion, learning, watchdog.

Imports `live.decision`, `live.network`, `calibration` and the rows below it. The
monitor starts `black_box`, `second_opinion` and `watchdog` by their names.

Public:
    companion_processes: `BLACK_BOX`, `CONSOLE`, `Companions`, `Guard`, `OPINION`
    decision_log: `DecisionLog`, `read_log`
    eye_learning: `resumed_eye`
    process_channel: `Channel`, `ChannelClosedError`, `Child`, `run_companion`
    process_messages: `BlackBoxSettings`, `CompanionMessage`, `ConsoleSettings`,
        `DECISION_DEVICE`, `Decided`, `Entry`, `EyeLearned`, `ForceHeard`, `ListensAt`,
        `NEEDLE_DEVICE`, `Note`, `OpinionAsked`, `OpinionGiven`, `OpinionSettings`,
        `Outline`, `READING_DEVICE`, `Rates`, `ResetAnswered`, `ResetAsked`, `START`,
        `STATUS_DEVICE`, `SelfReport`, `Settings`, `WithdrawalKept`, `WrongTokens`,
        `decision_text`
    shared_frames: `FrameRing`
    watchdog: `MONITOR_PRIORITY`, `run_in_real_time`, `stamp_time`
"""
