from bluerov_slam.evaluation.acoustic_cases import AcousticJob, all_cases, jobs_for


def rows_of(case_id: str, cell: str, draws: int = 30) -> dict[str, float]:
    case = all_cases()[case_id]
    outcome = case.run(AcousticJob(case_id, cell, 3, draws), {})
    rows = case.rows({each: [outcome] if each == cell else [] for each in case.cells})
    return {row.id: row.interval.value for row in rows}


def test_five_receivers_give_the_range() -> None:
    found = rows_of("I6", "2.6 m", 50)
    assert 3.0 < found["I6.2.6m"] < 9.0


def test_our_chain_beats_the_thesis_s_on_the_same_records() -> None:
    found = rows_of("I7", "2.6 m")
    assert found["I7.2.6m"] < 6.0
    assert found["I7.2.6m.thesis"] > 2.0 * found["I7.2.6m"]
    assert found["I7.2.6m.slips"] == 0.0


def test_yaw_rows_stand_without_a_single_dive() -> None:
    found = rows_of("I8", "yaw", 20)
    assert set(found) == {"I8.start", "I8.start.ratio", "I8.start.outside", "I8.moving"}
    assert found["I8.start"] < 0.6


def test_a_dive_is_one_block_of_draws() -> None:
    case = all_cases()["I8"]
    jobs = [job for job in jobs_for([case], 1000, 1000) if job.cell == "dive"]
    assert len({job.seed for job in jobs}) == len(jobs) == 20
