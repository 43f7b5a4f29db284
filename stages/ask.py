"""Stage `ask`: what to ask a person whose costs are not known, and the plan without it (thesis, section 6.2.2)."""

from __future__ import annotations

from pathlib import Path

from p2l.artifacts import write_text
from p2l.schema import AskConfig
from p2l.tracking import Tracker
from stages._progress import bar
from stages._shop import read_own_tasks
from stages._stage import stage


@stage("ask", AskConfig)
def run(cfg: AskConfig, out: Path, track: Tracker) -> None:
    """Write questions.csv, expected_orders.csv and the plan's tables; print the next question and the plan."""
    from p2l.team.preferences import expected_shop, question_values
    from p2l.team.preferences import files as tables
    from p2l.team.preferences.explain import explain_questions, questions_text
    from p2l.team.preferences.values import Optima
    from p2l.team.sheets import check_standard_input
    from p2l.team.shop.cautions import shop_cautions
    from p2l.team.shop.explain import explain_shop
    from p2l.team.shop.files import FILES, check_shop_place, write_shop_plan
    from p2l.team.shop.reasons import reasons_of

    check_shop_place(out, cfg.inputs, (*FILES, tables.QUESTIONS, tables.ORDERS))
    check_standard_input(*cfg.inputs)
    reading = read_own_tasks(cfg, cfg.order or "fixed", cfg.max_lessons, cfg.max_teaching)
    told = tables.read_preferences(
        cfg.prior, cfg.answers, reading.shop, reading.family, cfg.tasks, noise=cfg.noise, points=cfg.points
    )
    believed = told.preferences
    optima = Optima(reading.shop, believed, time_limit_s=cfg.time_limit_s)
    with bar("valuing questions", " questions") as show:
        values = question_values(
            reading.shop, believed, cfg.c_ask, look_ahead=cfg.look_ahead, optima=optima, progress=show
        )
    shop, day = expected_shop(reading.shop, believed), optima.at(believed.mean).plan
    reasons = reasons_of(shop, day, time_limit_s=cfg.reasons_s)
    remarks = (*reading.remarks, *told.remarks, *shop_cautions(shop))
    said = (reading.shop, believed, values, told.asked, cfg.c_ask)
    write_text(out / tables.ORDERS, tables.orders_text(cfg.tasks, shop))
    write_text(out / tables.QUESTIONS, questions_text(*said))
    write_shop_plan(out, shop, day, reasons, extra=reading.extra, remarks=remarks)
    track.metrics({"objective": day.objective, "questions": len(told.asked), "worth": values[0].value})
    notes = [f"Note: {remark}\n" for remark in remarks]
    print(*notes, explain_shop(shop, day, reasons), "\n\n", explain_questions(*said), sep="")


if __name__ == "__main__":
    run()
